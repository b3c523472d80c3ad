"""Convex parts that are made beside an open frame: those of a frame that waits, bit for bit; faults are heard of."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest

from tests.fakes import OneFrame, box_problem
from tests.physics.bodies import angle
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem
from verefine_viz.core.progress_token import NEVER_CANCELLED
from verefine_viz.physics import colliders
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.session_file import resolve
from verefine_viz.run.solids_ahead import SolidsAhead
from verefine_viz.run.toolbox import Toolbox


def of_angles() -> Problem:
    """Two boxes whose model is an L."""
    problem = box_problem(n_hypotheses=2, n_instances=2, seed=3)
    return replace(problem, models={obj_id: replace(angle(), obj_id=obj_id) for obj_id in problem.models})


def tools_of(problem: Problem) -> Toolbox:
    return Toolbox(resolve({"method": {"iterations": 1, "refiner": "icp"}}), source=OneFrame(problem))


@pytest.fixture(autouse=True)
def _cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def test_a_frame_opens_before_its_parts_are_made_and_its_run_is_that_of_one_that_waits(
    processes: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    others: SimpleQueue[ObjectModel] = SimpleQueue()
    is_open, decomposed = threading.Event(), colliders.decomposed

    def once_it_is_open(*given: Any) -> list[Float]:
        assert is_open.wait(60)
        return decomposed(*given)

    monkeypatch.setattr(colliders, "decomposed", once_it_is_open)
    ahead = SolidsAhead(others.put)
    early = tools_of(of_angles())
    run = early.run(early.problem("0/1", ahead=ahead), is_prepared=True)
    is_open.set()
    run.finish()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "waiting"))
    late = tools_of(of_angles())
    waited = late.run(late.problem("0/1"))
    waited.finish()
    ahead.stop()
    assert first_difference(run.problem.instances, waited.problem.instances) is None
    assert run.problem.notes == waited.problem.notes
    assert first_difference(run.iterations, waited.iterations) is None
    assert others.empty()


def test_parts_that_cannot_be_made_are_heard_of_and_leave_the_object_out_once_the_frame_is_read_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def failing(name: str, *_: object) -> None:
        raise ShapeError(f"{name} breaks CoACD")

    monkeypatch.setattr(colliders, "decomposed", failing)
    others: SimpleQueue[ObjectModel] = SimpleQueue()
    ahead, tools = SolidsAhead(others.put), tools_of(of_angles())
    assert len(tools.problem("0/1", ahead=ahead).instances) == 2
    assert others.get(timeout=60).name == "angle"
    with pytest.raises(ShapeError, match="breaks CoACD"):
        ahead.solid_of(angle(), NEVER_CANCELLED)
    with pytest.raises(InputError, match="no instance of frame 0/1 can be solved"):
        tools.problem("0/1", ahead=ahead)
    ahead.stop()
    assert others.empty()
