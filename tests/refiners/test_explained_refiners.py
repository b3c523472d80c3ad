"""What learned refiners say about a call is what they do, and it can be drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fakes import box_problem
from tests.learned.tiny_network import constant_network
from verefine_viz.core.algorithm_settings import DepthNetSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import angle_between, axis_angle, transform
from verefine_viz.core.problem import Placed, Target
from verefine_viz.core.refiner_steps import LearnedRefiner, RefinerStep, TrainedRange
from verefine_viz.core.settings import Session
from verefine_viz.pictures.refiner_crops import start_words, step_picture, step_words
from verefine_viz.refiners.depth_net import LARGEST_RAD, DepthNet
from verefine_viz.refiners.registry import REFINERS, WEIGHTS, make_refiner

TARGET = box_problem().targets[0]
STARTS = [h.T_cam_obj for h in box_problem(7).targets[0].instance.hypotheses]
NET = DepthNet(DepthNetSettings(), 0.0)


def explained(folder: Path, answer: list[float]) -> RefinerStep:
    (folder / "net.onnx").write_bytes(constant_network(np.array(answer)))
    (step,) = DepthNet(DepthNetSettings(weights=str(folder / "net.onnx"), iterations=1), 0.0).explain(TARGET, STARTS[0])
    return step


def test_only_learned_refiners_explain_themselves() -> None:
    own_weights = REFINERS.keys() - {"densefusion"}
    learned = {name for name in own_weights if isinstance(make_refiner(name, Session()), LearnedRefiner)}
    assert learned == WEIGHTS.keys() & own_weights


def test_the_steps_of_an_explanation_are_those_that_were_made() -> None:
    """Turn and shift of each step against the poses before and after it."""
    centre = (TARGET.model.vertices.min(axis=0) + TARGET.model.vertices.max(axis=0)) / 2
    for T in STARTS:
        poses = [T, *(step.Ts_cam_obj[0] for step in NET.steps(TARGET, T))]
        for (before, after), step in zip(pairwise(poses), NET.explain(TARGET, T), strict=True):
            moved_m = np.linalg.norm((after - before)[:3, :3] @ centre + (after - before)[:3, 3])
            turned_rad = angle_between(after[:3, :3], before[:3, :3])
            assert turned_rad == pytest.approx(np.linalg.norm(step.turn) if step.is_taken else 0, abs=1e-6), T
            assert moved_m == pytest.approx(np.linalg.norm(step.shift_m) if step.is_taken else 0, abs=1e-9), T


def test_explaining_changes_no_answer_and_out_of_sight_there_is_nothing_to_explain() -> None:
    refiner = make_refiner("depth_net_icp", Session())
    assert isinstance(refiner, LearnedRefiner)
    first = refiner.refine(TARGET, STARTS[0])
    refiner.explain(TARGET, STARTS[1])
    assert np.array_equal(refiner.refine(TARGET, STARTS[0]), first)
    away = np.array(STARTS[0])
    away[2, 3] = -1.0
    assert NET.explain(TARGET, away) == []


def test_a_step_that_is_not_taken_and_one_that_is_shortened_say_so(tmp_path: Path) -> None:
    radius_mm = 500 * TARGET.model.diameter_m
    stays = explained(tmp_path, [0, 0, 0, 0.1, 0, 0, np.log(0.3)])
    assert not stays.is_taken
    assert stays.expected_mm == pytest.approx(0.3 * radius_mm, rel=1e-5)
    assert "not taken" in step_words(stays)[0]
    long = explained(tmp_path, [50.0, 0, 0, 0, 0, 0, -3.0])
    assert np.linalg.norm(long.turn) == pytest.approx(LARGEST_RAD)


def test_an_expected_error_beyond_the_trained_range_is_said_with_both_numbers() -> None:
    (step, *_) = NET.explain(TARGET, STARTS[0])
    assert step.trained_mm is not None
    beyond = RefinerStep(**{**vars(step), "expected_mm": 2 * step.trained_mm})
    assert f"trained to {step.trained_mm:.0f} mm" in step_words(beyond)[1]
    assert "trained" not in step_words(RefinerStep(**{**vars(step), "expected_mm": step.trained_mm / 2}))[1]


def test_the_line_over_the_rendered_crop_is_the_shift(tmp_path: Path) -> None:
    """The picture of a step to the right differs from that of none right of the middle only."""
    still, right = (explained(tmp_path, [0, 0, 0, x, 0, 0, -9.0]) for x in (0.0, 0.5))
    changed = np.argwhere((step_picture(still) != step_picture(right)).any(axis=2))
    height, width = step_picture(right).shape[:2]
    assert len(changed)
    assert (changed[:, 0] < height / 2).all()
    assert (changed[:, 1] >= 3 * width / 4 - 6).all()


class Shift:
    """A user's own refiner: a millimetre to the right."""

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        return transform(T_cam_obj[:3, :3], T_cam_obj[:3, 3] + [1e-3, 0, 0])


class ExplainedShift(Shift):
    trained_range = TrainedRange(rotation_deg=20, shift_radii=0.5)

    def explain(self, target: Target, T_cam_obj: Float) -> list[RefinerStep]:
        return [RefinerStep({"depth": target.observation.depth_m}, shift_m=np.array([1e-3, 0, 0]))]


def own(refiner: object, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setitem(REFINERS, "own", lambda session: refiner)
    return make_refiner("own", Session())


def test_a_users_own_refiner_may_explain_itself_and_name_its_range(monkeypatch: pytest.MonkeyPatch) -> None:
    refiner = own(ExplainedShift(), monkeypatch)
    assert isinstance(refiner, LearnedRefiner)
    assert refiner.trained_range == ExplainedShift.trained_range
    (step,) = refiner.explain(TARGET, STARTS[0])
    assert step_words(step) == ("0.0°, 1.0 mm",)
    assert len(np.unique(step_picture(step).reshape(-1, 3), axis=0)) > 10
    plain = own(Shift(), monkeypatch)
    assert not isinstance(plain, LearnedRefiner)


def test_a_step_that_cannot_be_drawn_is_refused() -> None:
    for given in (
        {"crops": {}},
        {"crops": {"a": np.zeros((4, 4)), "b": np.zeros((4, 5))}},
        {"crops": {"a": np.zeros((4, 4, 2))}},
        {"crops": {"a": np.zeros((4, 4))}, "turn": np.zeros((3, 3))},
    ):
        with pytest.raises(ShapeError, match="of a RefinerStep"):
            RefinerStep(**given)


def test_where_a_call_began_is_said_against_the_range() -> None:
    T_gt, refiner = TARGET.instance.T_cam_obj_gt, make_refiner("depth_net", Session())
    far = transform(axis_angle([0, 0, 1], np.deg2rad(80)) @ T_gt[:3, :3], T_gt[:3, 3])
    bare = replace(TARGET, model=replace(TARGET.model, symmetries=np.eye(4)[None]))
    range_mm = 0.8 * 500 * bare.model.diameter_m
    assert start_words(refiner, bare, far).endswith(f"off: out of range, trained to 60°, {range_mm:.0f} mm")
    assert start_words(refiner, bare, T_gt) == f"began 0°, 0 mm off, trained to 60°, {range_mm:.0f} mm"
    unknown = replace(bare, instance=replace(bare.instance, T_cam_obj_gt=None))
    assert start_words(refiner, unknown, far) == ""
    assert start_words(make_refiner("icp", Session()), bare, far) == ""
