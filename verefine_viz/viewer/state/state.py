"""What is open, how it is shown, what is computed, and what the page says: all that commands change."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from verefine_viz.core.errors import InputError
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.run.compare import Departures, Pair, aligned, departures
from verefine_viz.run.engine import Run
from verefine_viz.viewer.commands import Command, Goal, RunB, RunTo
from verefine_viz.viewer.state.batch_gallery import Browsing, Gallery
from verefine_viz.viewer.state.branch import Branch, ComparisonChoice
from verefine_viz.viewer.state.grasp_trials import GraspTrials
from verefine_viz.viewer.state.view_options import ViewOptions
from verefine_viz.viewer.state.workspace import Workspace, WrittenFile

if TYPE_CHECKING:
    from verefine_viz.run.toolbox import Toolbox

_TIMED = 20
"""Iterations whose mean duration says how long the others will take."""


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


@dataclass(frozen=True, eq=False)
class Compared:
    """Two runs, as far as they are computed."""

    a: Run
    b: Run
    pairs: tuple[Pair, ...]
    departures: Departures

    def place(self, moment: tuple[int, int] | None) -> int | None:
        """Number of the pair that ``moment`` (instance_id, n) names, from 1; None = there is no such."""
        return next((k for k, pair in enumerate(self.pairs, 1) if pair[:2] == moment), None)

    def a_at(self, place: int) -> int:
        """The latest iteration that A has made at that place; 0 = none."""
        return max((pair.a for pair in self.pairs[:place] if pair.a is not None), default=0)


class Comparison:
    """The comparison of the open run, A, with another one, B, if there is one."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self.goal: tuple[Branch, int | None] | None = None
        """The branch that is computed and up to which length, None = to its end."""
        self._noted: tuple[Run, int] | None = None
        self._known: tuple[tuple[Run, int, Run, int], Compared] | None = None

    @property
    def is_running(self) -> bool:
        """Whether B is being computed."""
        return self.goal is not None

    @property
    def choice(self) -> ComparisonChoice | None:
        """What B is and how both are shown; None = nothing is compared."""
        return self._workspace.work.comparison

    def branch_b(self) -> Branch | None:
        """The branch beside the open one."""
        choice, branches = self.choice, self._workspace.work.branches
        return branches[choice.b] if choice is not None and choice.b < len(branches) else None

    def progress(self) -> tuple[Command, ...]:
        """What the log has to say before the next command, since it may depend on how far B is."""
        if self.goal is None:
            return ()
        run = self.goal[0].run
        if run.length == 0 or self._noted == (run, run.length):
            return ()
        self._noted = (run, run.length)
        return (RunB(run.length),)

    def visible(self, options: ViewOptions) -> ViewOptions:
        """``options`` without the layers that would hide the two runs."""
        return options if self.choice is None else replace(options, layers=options.layers - self.choice.hidden)

    def compared(self) -> Compared | None:
        """Both runs against each other; None while nothing is compared."""
        other = self.branch_b()
        if other is None:
            return None
        a, b = self._workspace.run, other.run
        key = (a, a.length, b, b.length)
        if self._known is None or self._known[0] != key:
            pairs = aligned(a.iterations, b.iterations)
            self._known = key, Compared(a, b, pairs, departures(a, b, pairs))
        return self._known[1]

    def place(self) -> int:
        """The pair of iterations that both are at, from 1; 0 before the first."""
        compared, choice, cursor = self.compared(), self.choice, self._workspace.run.cursor
        assert compared is not None
        assert choice is not None
        place = compared.place(choice.moment)
        if place is not None and compared.a_at(place) == cursor:
            return place
        if compared.a.at_end:
            return len(compared.pairs)
        return next((k for k, pair in enumerate(compared.pairs, 1) if pair.a == cursor), 0)


class State:
    """A session on the page. For what opens it see :class:`Workspace`.

    Args:
        demos: names of the built-in scenes.
        write: writes what :class:`~commands.SaveSession` and :class:`~commands.Export` ask for, and says where.
        sessions: lists the session files at hand.
        batch: whose answers are listed; None = no batch.
        frame: what is opened first; None = the first of the session.
    """

    def __init__(
        self,
        session: Session,
        path: Path | None,
        make_tools: Callable[[Session], Toolbox],
        plausibility: Callable[..., Any] | None = None,
        demos: tuple[str, ...] = (),
        write: Callable[[State, Command], WrittenFile] | None = None,
        sessions: Callable[[], tuple[str, ...]] = tuple,
        batch: Gallery | None = None,
        progress: ProgressToken = NEVER_CANCELLED,
        overlap: Callable[..., Any] | None = None,
        frame: str | None = None,
    ) -> None:
        self.workspace = Workspace(session, path, make_tools, plausibility, progress, overlap, frame)
        self.browsing = Browsing(batch, self.workspace)
        self.comparison = Comparison(self.workspace)
        self.running = Running()
        self.grasps = GraspTrials(progress)
        self.options = (
            ViewOptions(preset="gallery", arrangement=batch.first_arrangement) if batch is not None else ViewOptions()
        )
        self.demos, self.list_sessions, self.write = demos, sessions, write
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
        """Shows an iteration of the history as a whole."""
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
