"""The real methods on fake parts: a toolbox for tests of the page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from msgspec import structs

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.errors import InputError
from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import Watcher
from verefine_viz.core.settings import Session, StartPose
from verefine_viz.methods.registry import make_method
from verefine_viz.observation.dependency_graph import dependency_graph
from verefine_viz.run.edits import edits_of
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import AT_ITS_START, changed
from verefine_viz.run.start_poses import with_starts


class FakeTools:
    """Frames "0/1" (one box) and "0/2" (two boxes)."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.verifier = self.picture_verifier = FakeVerifier()

    @property
    def frames(self) -> tuple[str, ...]:
        return ("0/1", "0/2")

    @property
    def method(self) -> Any:
        s = self.session
        simulator = FakeSimulator() if s.physics.enabled else None
        return make_method(s.method, simulator, FakeRefiner(), self.verifier, s.physics.steps)

    def refiner_of(self, index: int) -> Any:
        return self.method.refiner

    def problem(self, frame: str, **_: object) -> Problem:
        if frame not in self.frames:
            raise InputError(f"no frame {frame}")
        n = int(frame[-1])
        problem = replace(box_problem(n_hypotheses=3, n_instances=n, seed=3), im_id=n)
        return with_starts(problem, self.session.starts)

    def changed(self, settings: dict[str, dict[str, Any]]) -> FakeTools:
        return type(self)(changed(self.session, settings))

    def restarted(self, settings: dict[str, dict[str, Any]], starts: tuple[StartPose, ...] = ()) -> FakeTools:
        session = changed(self.session, settings, AT_ITS_START)
        return type(self)(structs.replace(session, edits=(), changes=(), starts=starts))

    def ordered(self, problem: Problem) -> Problem:
        return replace(problem, dependencies=dependency_graph(problem, self.session.dependency))

    def run(self, problem: Problem, watchers: Sequence[Watcher[Any]] = (), is_prepared: bool = False) -> Run:
        changes = {c.after_iteration: self.changed(c.settings).method for c in self.session.changes}
        edits = edits_of(self.session.edits, problem, is_only_frame=len(self.frames) == 1)
        return Run(self.method, problem, watchers, edits, changes)
