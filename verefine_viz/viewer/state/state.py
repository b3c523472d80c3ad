"""What is open, how it is looked at, and what was said and written: all that commands change."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.session.engine import Run
from verefine_viz.viewer.commands import Command, Goal, RunTo
from verefine_viz.viewer.state.branch import Tools
from verefine_viz.viewer.state.comparison import Comparison
from verefine_viz.viewer.state.gallery import Browsing, Gallery
from verefine_viz.viewer.state.view_options import ViewOptions
from verefine_viz.viewer.state.workspace import Workspace, WrittenFile

_TIMED = 20
"""Iterations whose mean duration tells how long the others will take."""


class Unconfirmed(InputError):
    """Something would be lost: nothing was done, and ``command`` does it all the same.

    Args:
        text: what would be lost, and what else can be done; the link ends it.
        label: words of the link.
        command: what the link sends.
    """

    def __init__(self, text: str, label: str, command: Command) -> None:
        super().__init__(text)
        self.label, self.command = label, command


@dataclass
class Running:
    """What the open run is computed to, and how fast."""

    goal: Goal | int | None = None
    """A number is a length of the timeline; None = nothing is computed."""

    def __post_init__(self) -> None:
        self._timed: Run | None = None
        self._seconds: deque[float] = deque(maxlen=_TIMED)

    def step(self, run: Run) -> Iteration:
        """One iteration forward, through the history and past its end; what is computed is timed.

        Raises:
            InputError: the run is over.
        """
        length, began = run.length, perf_counter()
        iteration = run.step()
        if run.length > length:
            if run is not self._timed:
                self._timed = run
                self._seconds.clear()
            self._seconds.append(perf_counter() - began)
        return iteration

    def remaining_s(self, run: Run) -> float | None:
        """Estimated time to the end of the run [s]; None where nothing of it was timed yet."""
        if run is not self._timed:
            return None
        return (run.n_iterations - run.length) * sum(self._seconds) / len(self._seconds)


class State:
    """A session being looked at.

    Args:
        session: what to open.
        path: its file, if it has one.
        make_tools: builds simulator, refiner, verifier, method and scene from a session.
        plausibility: judges a pose by physics without moving it; None = not known.
        demos: names of the built-in scenes.
        keep: writes what :class:`~commands.SaveSession` and :class:`~commands.Export` ask for, and says where.
        sessions: lists the session files at hand.
        batch: whose answers are listed; None = no batch.
        progress: checked before anything that may take seconds.
        overlap: tells how deep one placed object is in another; None = not known.
    """

    def __init__(
        self,
        session: Session,
        path: Path | None,
        make_tools: Callable[[Session], Tools],
        plausibility: Callable[..., Any] | None = None,
        demos: tuple[str, ...] = (),
        keep: Callable[[State, Command], WrittenFile] | None = None,
        sessions: Callable[[], tuple[str, ...]] = tuple,
        batch: Gallery | None = None,
        progress: ProgressToken = NEVER_CANCELLED,
        overlap: Callable[..., Any] | None = None,
    ) -> None:
        self.workspace = Workspace(session, path, make_tools, plausibility, progress, overlap)
        self.browsing = Browsing(batch, self.workspace)
        self.comparison = Comparison(self.workspace)
        self.running = Running()
        self.options = ViewOptions()
        self.demos, self.list_sessions, self.keep = demos, sessions, keep
        self.sessions = sessions()
        self.message = ""
        self.refused = False
        """Whether the message says what went wrong."""
        self.offer: tuple[str, Command] | None = None
        """Words and command of a link behind the message: does what was refused all the same."""
        self.edit_hint = ""
        """What can be done with the edited pose."""
        self.written: tuple[WrittenFile, ...] = ()
        self.log: list[Command] = []
        """What was done, so that doing it again gives the same: runs appear as where they ended."""

    @property
    def run(self) -> Run:
        """The open run."""
        return self.workspace.run

    def seek(self, cursor: int) -> None:
        """Looks at an iteration of the history as a whole."""
        self.run.seek(cursor)
        self.options = self.options.moved()

    def step(self) -> Iteration:
        """One iteration of the open run forward."""
        iteration = self.running.step(self.run)
        self.options = self.options.moved()
        return iteration

    def pause(self) -> None:
        """Stops computing the open run after the iteration at hand."""
        if self.running.goal is not None:
            self.running.goal = None
            self.log.append(RunTo(self.run.length))

    def pause_b(self) -> None:
        """Stops computing B of a comparison after the iteration at hand."""
        if self.comparison.is_running:
            self.log.extend(self.comparison.progress())
            self.comparison.goal = None
