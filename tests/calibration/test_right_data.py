"""Right data of many kinds are not doubted, whatever the sensor, the crop, or poor initial poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.calibration.right_variants import POOR, RIGHT, close_views, estimated, has_truth, off
from tests.calibration.sizes import real, scene, with_instances
from tests.calibration.spoiled import CLUTTER
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.calibration.depth_steps import coarse_depth
from verefine_viz.core.doubt import DoubtKind
from verefine_viz.core.problem import Problem


@pytest.mark.parametrize("name", RIGHT)
def test_right_data_are_not_doubted_with_truth_or_without(name: str) -> None:
    for frame in (("clutter", "0/0"), ("mug", "0/0")):
        rng = np.random.default_rng(0)
        problem = RIGHT[name](scene(*frame), rng)
        if not problem.instances:
            continue
        assert data_doubts(problem) == (), frame
        if has_truth(problem):
            assert data_doubts(estimated(problem, off(rng, 5, 5))) == (), frame


def assert_no_doubt_at_any_error(problem: Problem) -> None:
    rng = np.random.default_rng(0)
    assert data_doubts(problem) == ()
    for degrees_mm in (0.0, 15.0, 40.0):
        for _ in range(3):
            assert data_doubts(estimated(problem, off(rng, degrees_mm, degrees_mm))) == (), degrees_mm


@pytest.mark.parametrize("name", ["clutter", "stack", "mug", "duck", "bracket"])
def test_built_in_scenes_are_not_doubted_whatever_their_estimates(name: str) -> None:
    assert_no_doubt_at_any_error(scene(name))


@pytest.mark.parametrize("frame", ["0/1", "49/2365", "50/1"])
def test_real_frames_are_not_doubted_whatever_their_estimates(shared_data: Path, frame: str) -> None:
    assert_no_doubt_at_any_error(real(shared_data / "ycbv", frame))


def test_a_frame_without_any_pose_is_not_doubted() -> None:
    assert data_doubts(with_instances(CLUTTER, lambda i: replace(i, T_cam_obj_gt=None, hypotheses=()))) == ()


@pytest.mark.parametrize("name", POOR)
def test_a_poor_pose_in_a_close_view_accuses_no_mesh(name: str) -> None:
    rng = np.random.default_rng(1)
    for margin, problem in close_views([scene("clutter", "0/0"), scene("mug", "0/0"), scene("duck", "0/0")]):
        kinds = {doubt.kind for doubt in data_doubts(estimated(problem, POOR[name](rng)))}
        assert not kinds & {DoubtKind.MODEL_SCALE, DoubtKind.IN_METRES}, margin


def test_a_narrow_range_of_depth_is_not_stored_in_8_bits() -> None:
    rng = np.random.default_rng(0)
    table_m, close_m = rng.uniform(0.92, 1.0, (60, 80)), rng.uniform(0.12, 0.25, (60, 80))
    assert coarse_depth(np.round(table_m, 3)) == ()
    assert coarse_depth(np.round(close_m, 3)) == ()
    (doubt,) = coarse_depth(np.round(rng.uniform(0.4, 1.0, (60, 80)) * 255) / 255)
    assert doubt.kind == DoubtKind.DEPTH_STEPS
