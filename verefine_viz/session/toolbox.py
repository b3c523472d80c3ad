"""The composition root: builds the real simulator, refiner, verifier, method and scene from a session."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import Refiner, Verifier, Watcher
from verefine_viz.core.settings import Session
from verefine_viz.methods.per_object import PerObject
from verefine_viz.methods.registry import make_method
from verefine_viz.physics.simulator import BulletSimulator
from verefine_viz.refiners.registry import make_refiner
from verefine_viz.rendering.verifier import make_verifier
from verefine_viz.scenes.source import SceneSource, open_scene
from verefine_viz.session.engine import Run
from verefine_viz.session.files import changed


class Toolbox:
    """Everything a session needs, built when it is first asked for. Belongs to one thread (OpenGL does)."""

    def __init__(self, session: Session) -> None:
        self.session = session

    @cached_property
    def source(self) -> SceneSource:
        return open_scene(self.session.scene, self.session.hypotheses)

    @cached_property
    def verifier(self) -> Verifier:
        return make_verifier(self.session.score)

    @cached_property
    def simulator(self) -> BulletSimulator | None:
        """None where the session switches physics off."""
        return BulletSimulator(self.session.physics) if self.session.physics.enabled else None

    @cached_property
    def refiner(self) -> Refiner:
        return make_refiner(self.session.method.refiner, self.session)

    @cached_property
    def method(self) -> PerObject:
        s = self.session
        return make_method(s.method, self.simulator, self.refiner, self.verifier, s.physics.steps)

    @property
    def frames(self) -> tuple[str, ...]:
        """Every frame the session names, as "scene/image"."""
        return self.source.frames

    def problem(self, frame: str) -> Problem:
        """The frame with its instances and hypotheses."""
        return self.source.problem(frame)

    def changed(self, settings: dict[str, dict[str, Any]]) -> Toolbox:
        """A toolbox with some settings replaced; what did not change is shared."""
        other = Toolbox(changed(self.session, settings))
        other.__dict__["source"] = self.source
        if other.session.score == self.session.score:
            other.__dict__["verifier"] = self.verifier
        if other.session.physics == self.session.physics:
            other.__dict__["simulator"] = self.simulator
        return other

    def prepare(self, problem: Problem) -> None:
        """Builds what is built once per model and kept on disk, so that no iteration waits for it (seconds each).

        Raises:
            ShapeError: a mesh from which no solid can be made.
        """
        if self.simulator is not None and problem.observation.support is not None:
            for target in problem.targets:
                self.simulator.collider(target.model)

    def run(self, problem: Problem, watchers: Sequence[Watcher[Any]] = ()) -> Run:
        """A run of the session's method on ``problem``, with the edits and changes that the session holds."""
        self.prepare(problem)
        changes: dict[int, Any] = {}
        toolbox = self
        for change in sorted(self.session.changes, key=lambda c: c.after_iteration):
            toolbox = toolbox.changed(change.settings)
            changes[change.after_iteration] = toolbox.method
        ids = {i.instance_id for i in problem.instances}
        edits = [e for e in self.session.edits if e.instance in ids]
        return Run(self.method, problem, watchers, edits, changes)
