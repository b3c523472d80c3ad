"""Every kind of event, and every breakpoint, comes from an iteration of a method that is stepped, not made by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import pytest

from tests.changing import replace
from tests.fakes import BOX_M, FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from tests.methods.test_flips import run_of as flipping
from tests.methods.test_flips import turned
from verefine_viz.core.algorithm_settings import BreakpointSettings
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import SettingsError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.problem import DependencyGraph, Hypothesis, Placed, Problem, Target
from verefine_viz.core.records import EventKind, Iteration
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, ScoreSettings
from verefine_viz.methods.registry import make_method
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.run.breakpoints import UNITS, hits, number_of, with_changes
from verefine_viz.run.engine import Run

PROBLEM = box_problem(2)
LEFT = transform(np.eye(3), [-0.03, 0, 0])
TURNED = transform(axis_angle([0, 0, 1], 0.5), [0, 0, 0])


@dataclass(frozen=True)
class Moves:
    """A refiner that always moves the object by the same."""

    by: Float

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        return self.by @ T_cam_obj


class NotANumber(FakeVerifier):
    """A verifier that fails for what has moved by more than 5 mm from the first hypothesis, as a plug-in might."""

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        scores = super().score(target, Ts_cam_obj, placed)
        far = np.abs(Ts_cam_obj[:, 0, 3] - target.instance.hypotheses[0].T_cam_obj[0, 3]) > 0.005
        return Scores(
            np.where(far, np.nan, scores.score),
            scores.depth_fit,
            scores.normal_fit,
            scores.n_pixels,
            scores.n_rendered,
            scores.counts,
        )


def with_initial_pose(T_cam_obj: Float) -> Problem:
    """The box with one hypothesis."""
    instance = replace(PROBLEM.instances[0], hypotheses=(Hypothesis(T_cam_obj, 1.0, "made"),))
    return replace(PROBLEM, instances=(instance,))


def leaning(deg: float) -> Problem:
    """The box on its lower edge on the table (y = 0.12 m, y is down)."""
    R = axis_angle([0, 0, 1], np.deg2rad(deg))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * BOX_M / 2
    return with_initial_pose(transform(R, [0, 0.12 - float((corners @ R.T)[:, 1].max()), 0.6]))


def run(
    name: str = "sir", *, problem: Problem = PROBLEM, refiner: object = None, verifier: object = None,
    simulator: object = None, physics: bool = True, **fields: object,
) -> Run:  # fmt: skip
    s = msgspec.convert({"name": name, **fields}, MethodSettings)
    parts = (simulator or FakeSimulator()) if physics else None, refiner or FakeRefiner(), verifier or FakeVerifier()
    return Run(make_method(s, *parts, 3), problem)  # pyright: ignore[reportArgumentType]


def finished(**fields: object) -> Run:
    made = run(**fields)  # pyright: ignore[reportArgumentType]
    made.finish()
    return made


def by_hand() -> Run:
    made = run().fork(0, edit=(0, 0, LEFT @ PROBLEM.instances[0].hypotheses[0].T_cam_obj))
    made.finish()
    return made


def scene() -> Run:
    both = replace(box_problem(2, 2), dependencies=DependencyGraph((), ((0, 1),), ((0, 1),), "given"))
    return finished(name="vf_depth", problem=both)


def turned_over() -> Run:
    made = flipping("sir", turned(box_problem(2, seed=3), (0, 2)))
    made.finish()
    return made


def toppling(tmp_path: Path) -> Run:
    return finished(problem=leaning(20), simulator=BulletSimulator(PhysicsSettings(), tmp_path))


def standing(tmp_path: Path) -> Run:
    return finished(problem=leaning(0), simulator=BulletSimulator(PhysicsSettings(), tmp_path))


def held_too_high(tmp_path: Path) -> Run:
    """The box where it is, on a plane that was taken for 30 mm higher than the table is."""
    problem = with_initial_pose(transform(np.eye(3), [0, 0.12 - BOX_M[1] / 2, 0.6]))
    support = problem.observation.support
    higher = replace(support, T_world_cam=transform(np.eye(3), [0, 0, -0.03]) @ support.T_world_cam)
    problem = replace(problem, observation=replace(problem.observation, support=higher))
    return finished(problem=problem, simulator=BulletSimulator(PhysicsSettings(), tmp_path))


def out_of_view(tmp_path: Path) -> Run:
    aside = with_initial_pose(transform(np.eye(3), [5.0, 0, 0.6]))
    return finished(problem=aside, verifier=CpuVerifier(ScoreSettings(), tmp_path), refiner=Moves(np.eye(4)))


def not_a_number(tmp_path: Path) -> Run:
    return finished(verifier=NotANumber(), refiner=Moves(LEFT))


Made = Callable[[Path], Run]
UNEVENTFUL: Made = lambda _: finished(refiner=Moves(np.eye(4)), name="refine")  # noqa: E731

EVENTS: dict[str, Made] = {
    "kept_refined": lambda _: finished(),
    "kept_simulated": lambda _: finished(refiner=Moves(LEFT)),
    "flipped": lambda _: turned_over(),
    "score_fell": lambda _: finished(refiner=Moves(LEFT)),
    "new_best": lambda _: finished(),
    "arm_switched": lambda _: finished(name="rir", exploration=5.0),
    "unstable": toppling,
    "physics_worse": held_too_high,
    "empty_render": out_of_view,
    "nan_score": not_a_number,
    "refiner_stuck": lambda _: finished(refiner=Moves(np.eye(4))),
    "no_physics": lambda _: finished(physics=False),
    "edited": lambda _: by_hand(),
    "new_best_scene": lambda _: scene(),
}

BREAKPOINTS: dict[str, tuple[float | bool, Made, str]] = {
    "score_falls_by": (0.1, EVENTS["score_fell"], "0.1"),
    "simulated_rejected": (True, EVENTS["kept_refined"], "simulated"),
    "refined_rejected": (True, EVENTS["kept_simulated"], "Refined"),
    "jump_mm": (20.0, lambda _: finished(name="refine", refiner=Moves(LEFT)), "30.0 mm"),
    "jump_deg": (20.0, lambda _: finished(name="refine", refiner=Moves(TURNED)), "28.6°"),
    "arm_switched": (True, EVENTS["arm_switched"], "hypothesis"),
    "unstable": (True, toppling, "turned"),
    "physics_worse": (True, held_too_high, "Physics"),
    "empty_render": (True, out_of_view, "outside of the image"),
    "error_grows_by_mm": (5.0, lambda _: finished(name="refine", refiner=Moves(LEFT)), "5 mm"),
}
"""A value with which it stops, a run that it stops, and what the reason names."""


def kinds(iterations: tuple[Iteration, ...]) -> set[str]:
    return {event.kind for it in iterations for event in it.events}


def test_every_event_comes_from_an_iteration(tmp_path: Path) -> None:
    assert set(EVENTS) == set(get_args(EventKind))
    for kind, made in EVENTS.items():
        assert kind in kinds(made(tmp_path).iterations)


def test_every_breakpoint_is_hit_by_an_iteration(tmp_path: Path) -> None:
    assert set(BREAKPOINTS) == set(BreakpointSettings.__struct_fields__) - {"waiting"}
    calm = UNEVENTFUL(tmp_path)
    for name, (value, made, why) in BREAKPOINTS.items():
        stops, played = msgspec.convert({name: value}, BreakpointSettings), made(tmp_path)
        reasons = [reason for it in played.iterations for reason in hits(stops, played.problem, it)]
        assert reasons, name
        assert all(why in reason for reason in reasons), reasons
        assert not any(hits(BreakpointSettings(), played.problem, it) for it in played.iterations), name
        assert not any(hits(stops, calm.problem, it) for it in calm.iterations), name


def test_a_score_that_is_not_a_number_is_reported_and_stops_the_run(tmp_path: Path) -> None:
    played = not_a_number(tmp_path)
    first = played.iterations[0]
    (text,) = (event.text for event in first.events if event.kind == "nan_score")
    assert first.accepted == "simulated"
    assert hits(BreakpointSettings(empty_render=True), played.problem, first) == (text,)


def test_what_stands_is_not_called_unstable(tmp_path: Path) -> None:
    assert "unstable" not in kinds(standing(tmp_path).iterations)


def test_the_number_of_a_breakpoint_that_is_off_waits() -> None:
    off = with_changes(BreakpointSettings(jump_mm=25.0), (("jump_mm", None), ("waiting.jump_deg", 4.0)))
    assert (off.jump_mm, off.jump_deg) == (None, None)
    assert [number_of(off, name) for name in UNITS] == [None, 25.0, 4.0, None]
    assert with_changes(off, (("jump_mm", None),)) == off
    on = with_changes(off, (("jump_mm", 7.0),))
    assert (on.jump_mm, on.waiting.jump_mm, number_of(on, "jump_mm")) == (7.0, None, 7.0)
    assert with_changes(off, (("waiting.jump_mm", 3.0),)).waiting.jump_mm == 3.0


def test_what_is_no_breakpoint_or_no_value_of_one_is_refused_by_its_name() -> None:
    wrong: list[tuple[str, object]] = [("unstable", 7), ("jump", 1.0), ("waiting.unstable", 1.0)]
    for name in UNITS:
        wrong += [(name, -1.0), (f"waiting.{name}", float("nan")), (name, "far")]
    for name, value in wrong:
        with pytest.raises(SettingsError):
            with_changes(BreakpointSettings(), ((name, value),))
