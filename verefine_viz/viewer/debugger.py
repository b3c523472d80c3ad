"""The debugger without a screen: carries out commands, one after another, on one thread.

The page is one way to drive it; a list of commands is another, with the same result (:meth:`Debugger.carry_out`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.patience import ENDLESS, Patience
from verefine_viz.core.records import Iteration
from verefine_viz.core.settings import Session
from verefine_viz.session.breakpoints import with_changes
from verefine_viz.viewer import commands as c
from verefine_viz.viewer import comparison_commands as s
from verefine_viz.viewer.command_json import COMMANDS
from verefine_viz.viewer.handlers import looking
from verefine_viz.viewer.handlers.batch import Browsing
from verefine_viz.viewer.handlers.comparing import Comparing, as_done
from verefine_viz.viewer.handlers.editing import Posing
from verefine_viz.viewer.handlers.looking import asked
from verefine_viz.viewer.handlers.navigation import Moving, Running
from verefine_viz.viewer.handlers.opening import Opening
from verefine_viz.viewer.handlers.reordering import as_restart
from verefine_viz.viewer.snapshot.build import snapshot_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.branch import Tools
from verefine_viz.viewer.state.gallery import Gallery
from verefine_viz.viewer.state.view_options import ViewOptions
from verefine_viz.viewer.state.workspace import Workspace, WrittenFile

Keeper = Callable[["Debugger", c.Command], WrittenFile]


class Debugger:
    """A session being looked at.

    Args:
        session: what to open.
        path: its file, if it has one.
        make_tools: builds simulator, refiner, verifier, method and scene from a session.
        plausibility: judges a pose by physics without moving it; None = not known.
        demos: names of the built-in scenes.
        sessions: lists the session files at hand.
        batch: whose answers are listed; None = no batch.
        keep: writes what :class:`~commands.SaveSession` and :class:`~commands.Export` ask for, and says where.
        patience: asked before anything that may take seconds.
        overlap: tells how deep one placed object is in another; None = not known.
    """

    def __init__(
        self,
        session: Session,
        path: Path | None,
        make_tools: Callable[[Session], Tools],
        plausibility: Callable[..., Any] | None = None,
        demos: tuple[str, ...] = (),
        keep: Keeper | None = None,
        sessions: Callable[[], tuple[str, ...]] = tuple,
        batch: Gallery | None = None,
        patience: Patience = ENDLESS,
        overlap: Callable[..., Any] | None = None,
    ) -> None:
        self.workspace = Workspace(session, path, make_tools, plausibility, patience, overlap)
        self.demos = demos
        self.look = ViewOptions()
        self.message = ""
        self.refused = False
        """Whether the message says what went wrong."""
        self.offer: tuple[str, c.Command] | None = None
        """Words and command of a link behind the message: does what was refused all the same."""
        self.kept: tuple[WrittenFile, ...] = ()
        self.log: list[c.Command] = []
        """What was done, so that doing it again gives the same: runs appear as where they ended."""
        self._keep = keep
        self._list_sessions = sessions
        self.sessions = sessions()
        self.browsing = Browsing(batch, self.workspace)
        self.running = Running(self)
        self.comparing = Comparing(self)
        self._moving, self._opening, self._posing = Moving(self), Opening(self, sessions), Posing(self)

    # Driving it

    def apply(self, command: c.Command) -> None:
        """Begins to carry out a command; a run goes on with each :meth:`tick`.

        Raises:
            VerefineError: it cannot be done; everything is as before.
            Cancelled: nobody waits for it any more; everything is as before.
        """
        self.message, self.refused, self.offer = "", False, None
        was_busy = self.is_busy
        command = self.browsing.resolved(command, self.look)
        if not (isinstance(command, c.TogglePause) and was_busy):
            self._posing.refuse_loss(command)
        self.comparing.before(command)
        if not isinstance(command, c.RunUntil | c.RunTo | c.TogglePause | c.Pause | c.Cancel):
            if not _may_wait(command):
                self.running.pause()
            self._do(command)
            self.log.extend(_as_done(command, self.workspace.run.cursor))
            return
        if isinstance(command, c.Pause | c.Cancel) or (isinstance(command, c.TogglePause) and was_busy):
            self.running.pause()
            return
        self.running.pause()
        self.running.begin(command)

    def carry_out(self, commands: Iterable[c.Command]) -> Debugger:
        """Every command in order, each to its end."""
        for command in commands:
            self.apply(command)
            while self.is_busy:
                self.tick()
        return self

    def tick(self) -> Iteration | None:
        """One iteration of the open run, or else of B; None where the open one has none to make."""
        if self.running.goal is not None:
            return self.running.tick()
        self.comparing.tick()
        return None

    @property
    def is_busy(self) -> bool:
        """Whether a run is on, be it A's or B's."""
        return self.running.goal is not None or self.comparing.is_running

    def seek(self, cursor: int) -> None:
        """Looks at an iteration of the history as a whole."""
        self.workspace.run.seek(cursor)
        self.look = self.look.moved()

    def view(self, deep: bool = True) -> Snapshot:
        """What is to be seen now; if not ``deep`` without score maps, and plausibility only of an edited pose."""
        return snapshot_of(self, deep)

    # What the commands do

    def _do(self, command: c.Command) -> None:
        if self.comparing.do(command):
            return
        command = as_restart(command, self.workspace.work.problem, self.workspace.branch.tools.session.dependency)
        look = asked(looking.changed(self.look, command), command, self.workspace.run, self.look)
        if look is not None:
            self._check(look)
            self.look = look
            return
        if self._moving.do(command) or self._opening.do(command) or self._posing.do(command):
            return
        match command:
            case c.Fork(changes, cursor, run):
                at = self.workspace.run.cursor if cursor is None else cursor
                self.workspace.fork(at, changes)
                self.look = self.look.moved()
                self.running.goal = "end" if run else None
                if not run and not self.workspace.run.is_done:
                    self.message = f"A new branch from iteration {at}; Step or Run go on with it."
            case c.ShowBranch(index):
                self._show_branch(index)
            case c.SetBreakpoints(changes):
                self.workspace.breakpoints = with_changes(self.workspace.breakpoints, changes)
            case c.PlayPath():
                path = self._shown_path()
                self.look = replace(self.look, path_pose=len(path) - 1, layers=self.look.layers | {"path"})
            case c.SaveSession() | c.Export():
                if self._keep is None:
                    raise InputError("nothing can be written here")
                self.kept = (self._keep(self, command), *self.kept)[:4]
                self.sessions = self._list_sessions()
                self.message = f"Written: {self.kept[0].words}"
                if isinstance(command, c.SaveSession) and len(self.workspace.work.branches) > 1:
                    name = self.workspace.branch.name
                    self.message += f"; it holds the shown branch, “{name}”; others are saved one by one"
                if isinstance(command, c.SaveSession) and self.look.is_moved:
                    self.message += "; not the pose under the hand: press “Continue from here”, then save again"
            case _:
                raise InputError(unknown("command", type(command).__name__, COMMANDS))

    def _show_branch(self, index: int) -> None:
        work = self.workspace.work
        if not 0 <= index < len(work.branches):
            raise InputError(f"there is no branch {index}; this frame has {len(work.branches)}")
        work.index = index
        self.look = self.look.moved()

    def _shown_path(self) -> Any:
        shown = self.view(deep=False).shown
        if shown is None or shown.path is None:
            raise InputError("no simulated path here; step to an iteration with physics")
        return shown.path.Ts_cam_obj

    def _check(self, look: ViewOptions) -> None:
        problem = self.workspace.work.problem
        ids = [i.instance_id for i in problem.instances]
        if look.focus is not None and look.focus not in ids:
            raise InputError(unknown("instance", look.focus, ids))
        if look.pixel is not None:
            h, w = problem.observation.camera.shape
            if not (0 <= look.pixel[0] < w and 0 <= look.pixel[1] < h):
                raise InputError(f"pixel {look.pixel} is outside of the {w}×{h} image")


def _as_done(command: c.Command, cursor: int) -> tuple[c.Command, ...]:
    """What the log says of a command that may have begun a run: the run itself is noted when it ends."""
    if isinstance(command, c.Fork):
        return (replace(command, run=False),)
    if isinstance(command, c.OpenAt):
        return (replace(command, iteration=cursor),)
    if isinstance(command, c.Export):
        return (replace(command, client=None),)
    return as_done(command)


def _may_wait(command: c.Command) -> bool:
    """Whether a run may go on while this is done: neither looking nor what stands beside it disturbs it."""
    return isinstance(
        command,
        c.Focus | c.ShowScene | c.SelectArm | c.Compare | c.ShowMap | c.ProbePixel | c.ColorCloud | c.ShowLayer
        | c.Animate | c.SetBreakpoints | c.SortBatch | c.FilterBatch | c.TurnPage | c.ScoreGroundTruth | c.Export
        | s.CompareRun | s.CompareBranch | s.CompareRecording | s.RunB | s.PauseB | s.StopComparing | s.ShowSide
        | s.ShowSidePoses,
    )  # fmt: skip
