"""What the page needs of simulator, renderer, refiner, method and scene together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import Verifier, Watcher
from verefine_viz.core.settings import Session
from verefine_viz.session.engine import Run


class Tools(Protocol):
    """A toolbox; ``session.toolbox.Toolbox`` is the real one."""

    session: Session

    @property
    def frames(self) -> tuple[str, ...]: ...
    @property
    def verifier(self) -> Verifier: ...
    @property
    def method(self) -> Any: ...
    def problem(self, frame: str) -> Problem: ...
    def changed(self, settings: dict[str, dict[str, Any]]) -> Tools: ...
    def restarted(self, settings: dict[str, dict[str, Any]]) -> Tools: ...
    def ordered(self, problem: Problem) -> Problem: ...
    def run(self, problem: Problem, watchers: Sequence[Watcher[Any]] = ()) -> Run: ...
