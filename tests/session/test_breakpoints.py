"""Each breakpoint fires on its own condition and stays silent otherwise."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.records import Event, Iteration, Stage
from verefine_viz.core.settings import BreakpointSettings, MethodSettings
from verefine_viz.methods.registry import make_method
from verefine_viz.session.breakpoints import hits
from verefine_viz.session.engine import Run

PROBLEM = box_problem(2)


def iteration() -> Iteration:
    method = make_method(MethodSettings(name="sir"), FakeSimulator(), FakeRefiner(), FakeVerifier(), 3)
    return replace(Run(method, PROBLEM).step(), events=())


def with_kept(pose=None, score: float | None = None, events: tuple[Event, ...] = ()) -> Iteration:  # type: ignore[no-untyped-def]
    it = iteration()
    kept: Stage = it.accepted_stage
    T = kept.T_cam_obj if pose is None else it.stages[0].T_cam_obj @ pose
    changed = replace(kept, T_cam_obj=T, score=replace(kept.score, score=score if score is not None else 1.0))
    stages = tuple(changed if s is kept else s for s in it.stages)
    return replace(it, stages=stages, events=events)


CASES = {
    "score_falls_by": (0.1, with_kept(score=0.0), "the score fell by"),
    "simulated_rejected": (True, with_kept(events=(Event("kept_refined", "kept"),)), "simulated pose rejected"),
    "refined_rejected": (True, with_kept(events=(Event("kept_simulated", "Refined pose rejected"),)), "rejected"),
    "jump_mm": (20.0, with_kept(transform(axis_angle([1, 0, 0], 0.0), [0, 0, 0.03])), "jumped by 30.0 mm"),
    "jump_deg": (20.0, with_kept(transform(axis_angle([1, 0, 0], 0.5), [0, 0, 0])), "turned by 28.6°"),
    "arm_switched": (True, with_kept(events=(Event("arm_switched", "Switched"),)), "Switched"),
    "unstable": (True, with_kept(events=(Event("unstable", "turned"),)), "turned"),
    "empty_render": (True, with_kept(events=(Event("empty_render", "renders to nothing"),)), "renders to nothing"),
    "error_grows_by_mm": (5.0, with_kept(transform(axis_angle([1, 0, 0], 0.0), [0, 0, 0.5])), "error against ground"),
}


@pytest.mark.parametrize("name", CASES)
def test_a_breakpoint_fires_on_its_condition_only(name: str) -> None:
    value, record, text = CASES[name]
    assert any(text in reason for reason in hits(BreakpointSettings(**{name: value}), PROBLEM, record))
    assert hits(BreakpointSettings(), PROBLEM, record) == ()
    still = with_kept(pose=transform(axis_angle([1, 0, 0], 0.0), [0, 0, 0]))
    assert hits(BreakpointSettings(**{name: value}), PROBLEM, still) == ()


def test_every_breakpoint_is_tested() -> None:
    assert set(CASES) == set(BreakpointSettings.model_fields)
