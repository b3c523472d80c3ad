"""Carries out the commands that move through the open run, iteration by iteration or stage by stage."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from verefine_viz.session.engine import Run
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.command import Command
from verefine_viz.viewer.marks import jumps
from verefine_viz.viewer.running import OVER

if TYPE_CHECKING:
    from verefine_viz.viewer.debugger import Debugger


class Moving:
    """Where the debugger stands in its run."""

    def __init__(self, debugger: Debugger) -> None:
        self._debugger = debugger

    def do(self, command: Command) -> bool:
        """Carries out a command about the place in the run; False where it is about something else."""
        debugger, run = self._debugger, self._run
        match command:
            case c.Step():
                self._step()
            case c.StepStage():
                self._step_stage()
            case c.Back():
                debugger.seek(max(run.cursor - 1, 0))
            case c.Seek(cursor):
                debugger.seek(min(max(cursor, 0), run.length))
            case c.SeekStage(cursor, stage):
                debugger.seek(cursor)
                debugger.look = replace(debugger.look, stage=stage)
            case c.SeekEnd():
                debugger.seek(run.length)
            case c.SeekEvent(direction):
                self._seek_event(direction)
            case _:
                return False
        return True

    @property
    def _run(self) -> Run:
        return self._debugger.workspace.run

    def _step(self) -> None:
        if self._debugger.look.stage is not None:  # The rest of this iteration comes first.
            self._debugger.look = replace(self._debugger.look, stage=None)
        elif self._run.at_end:
            self._debugger.message = OVER
        else:
            self._debugger.running.step()

    def _step_stage(self) -> None:
        debugger, iteration = self._debugger, self._run.iteration
        names = [s.name for s in iteration.stages] if iteration else []
        if debugger.look.stage in names and debugger.look.stage != names[-1]:
            following = names[names.index(debugger.look.stage) + 1]
            debugger.look = replace(debugger.look, stage=following)
        elif debugger.look.stage is not None:
            debugger.look = replace(debugger.look, stage=None)
        elif not self._run.at_end:
            self._step()
            debugger.look = replace(debugger.look, stage="current")
        else:
            self._step()

    def _seek_event(self, direction: int) -> None:
        debugger, cursor = self._debugger, self._run.cursor
        places = jumps(debugger.workspace.branch.marks(debugger.look.focus))
        ahead = [k for k in places if (k > cursor if direction > 0 else k < cursor)]
        if not ahead:
            debugger.message = "No further mark there." if direction > 0 else "No earlier mark."
            return
        debugger.seek(min(ahead) if direction > 0 else max(ahead))
