"""Moves through the open run and computes it on, iteration by iteration or stage by stage."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from time import perf_counter
from typing import TYPE_CHECKING

from verefine_viz.core.records import Iteration
from verefine_viz.session.breakpoints import hits
from verefine_viz.session.engine import Run
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import Command
from verefine_viz.viewer.snapshot.scene_state import labels_of
from verefine_viz.viewer.state.timeline_marks import jumps

if TYPE_CHECKING:
    from verefine_viz.viewer.debugger import Debugger


# Computes the open run on, iteration after iteration, until a goal is reached.

OVER = "The run is over. Restart it, or fork it with other settings."
_TIMED = 20
"""Iterations whose mean duration tells how long the others will take."""


class Running:
    """What the debugger's open run is computed on to."""

    def __init__(self, debugger: Debugger) -> None:
        self._debugger = debugger
        self.goal: c.Goal | int | None = None
        """What is being run to; a number is a length of the timeline; None = nothing is computed."""
        self._timed: Run | None = None
        self._seconds: deque[float] = deque(maxlen=_TIMED)

    def begin(self, command: c.RunUntil | c.RunTo | c.TogglePause) -> None:
        """Goes to what a run in the history would stop at, or sets the goal."""
        debugger, run = self._debugger, self._run
        if isinstance(command, c.RunTo):
            self.goal = command.length
            return
        goal: c.Goal = command.goal if isinstance(command, c.RunUntil) else "end"
        if goal == "event":
            ahead = [k for k in jumps(debugger.workspace.branch.marks()) if k > run.cursor]
            if ahead:
                debugger.seek(ahead[0])
                debugger.log.append(c.Seek(ahead[0]))
                return
        if run.is_done:
            if run.at_end and debugger.look.stage is None:
                debugger.message = OVER
            debugger.seek(run.length)
            debugger.log.append(c.SeekEnd())
            return
        self.goal = goal

    def tick(self) -> Iteration | None:
        """One iteration towards the goal, or None if the run came to its end."""
        run = self._run
        if run.is_done or (isinstance(self.goal, int) and run.length >= self.goal):
            self.pause()
            return None
        run.seek(run.length)
        iteration = self.step()
        self._stop_if_reached(iteration)
        return iteration

    def step(self) -> Iteration:
        """One iteration forward, through the history and past its end; what is computed is timed.

        Raises:
            InputError: the run is over.
        """
        run = self._run
        length, began = run.length, perf_counter()
        iteration = run.step()
        if run.length > length:
            if run is not self._timed:
                self._timed = run
                self._seconds.clear()
            self._seconds.append(perf_counter() - began)
        self._debugger.look = self._debugger.look.moved()
        return iteration

    def pause(self) -> None:
        """Stops after the iteration at hand."""
        if self.goal is not None:
            self.goal = None
            self._debugger.log.append(c.RunTo(self._run.length))

    @property
    def remaining_s(self) -> float | None:
        """Estimated time to the end of the run [s]; None where nothing of it was timed yet."""
        run = self._run
        if run is not self._timed:
            return None
        return (run.n_iterations - run.length) * sum(self._seconds) / len(self._seconds)

    @property
    def _run(self) -> Run:
        return self._debugger.workspace.run

    def _stop_if_reached(self, iteration: Iteration) -> None:
        debugger, run = self._debugger, self._run
        if isinstance(self.goal, int):
            if run.length >= self.goal:
                stage = debugger.browsing.stage_asked_for(self.goal)
                self.pause()
                if stage is not None:
                    debugger.look = replace(debugger.look, stage=stage)
                    debugger.log.append(c.SeekStage(run.cursor, stage))
            return
        reasons = hits(debugger.workspace.breakpoints, run.problem, iteration)
        if reasons:
            names = labels_of(run.problem)
            where = f"iteration {iteration.index}" + (f", {names[iteration.instance_id]}" if len(names) > 1 else "")
            debugger.message = f"Breakpoint at {where}: {'; '.join(reasons)}"
            self.pause()
        elif self.goal == "event" and jumps(
            [m for m in debugger.workspace.branch.marks() if m.iteration == iteration.index]
        ):
            self.pause()


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
