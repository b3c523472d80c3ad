"""Right data of many kinds are not doubted, whatever the sensor, the crop or a single poor pose."""

from __future__ import annotations

import numpy as np
import pytest

from tests.calibration.right_variants import POOR, RIGHT, close_views, estimated, has_truth, off
from tests.calibration.sizes import scene
from verefine_viz.calibration.consistency import data_doubts
from verefine_viz.calibration.depth_steps import coarse_depth


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


@pytest.mark.parametrize("name", POOR)
def test_a_poor_pose_in_a_close_view_accuses_no_mesh(name: str) -> None:
    rng = np.random.default_rng(1)
    for margin, problem in close_views([scene("clutter", "0/0"), scene("mug", "0/0"), scene("duck", "0/0")]):
        for doubt in data_doubts(estimated(problem, POOR[name](rng))):
            assert "model" not in doubt.text, margin


def test_a_narrow_range_of_depth_is_not_stored_in_8_bits() -> None:
    rng = np.random.default_rng(0)
    table_m, close_m = rng.uniform(0.92, 1.0, (60, 80)), rng.uniform(0.12, 0.25, (60, 80))
    assert coarse_depth(np.round(table_m, 3)) == ()
    assert coarse_depth(np.round(close_m, 3)) == ()
    (doubt,) = coarse_depth(np.round(rng.uniform(0.4, 1.0, (60, 80)) * 255) / 255)
    assert "3.92 mm apart" in doubt.text
