"""Moves through the open run and computes it on, iteration by iteration or stage by stage."""

from __future__ import annotations

from dataclasses import replace

from verefine_viz.core.records import Iteration
from verefine_viz.run.breakpoints import hits, with_changes
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.scene_state import labels_of
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.timeline_marks import jumps

OVER = "The run is over. Restart it, or fork it with other settings."


def step(state: State, command: c.Step) -> None:
    """To the end of the iteration that is shown stage by stage, else one iteration forward."""
    if state.options.stage is not None:  # The rest of this iteration comes first.
        state.options = replace(state.options, stage=None)
    elif state.run.at_end:
        state.message = OVER
    else:
        state.step()


def _step_stage(state: State, command: c.StepStage) -> None:
    iteration, stage = state.run.iteration, state.options.stage
    names = [s.name for s in iteration.stages] if iteration else []
    if stage in names and stage != names[-1]:
        state.options = replace(state.options, stage=names[names.index(stage) + 1])
    elif stage is not None:
        state.options = replace(state.options, stage=None)
    elif state.run.at_end:
        state.message = OVER
    else:
        state.step()
        state.options = replace(state.options, stage="current")


def _seek_stage(state: State, command: c.SeekStage) -> None:
    state.seek(command.cursor)
    state.options = replace(state.options, stage=command.stage)


def _seek_event(state: State, command: c.SeekEvent) -> None:
    cursor, is_forward = state.run.cursor, command.direction > 0
    places = jumps(state.workspace.branch.marks(state.options.focus))
    ahead = [k for k in places if (k > cursor if is_forward else k < cursor)]
    if not ahead:
        state.message = "No further mark there." if is_forward else "No earlier mark."
        return
    state.seek(min(ahead) if is_forward else max(ahead))


# Running


def _run_until(state: State, command: c.RunUntil) -> None:
    """Goes to what a run in the history would stop at, or sets the goal."""
    run = state.run
    if command.goal == "event":
        ahead = [k for k in jumps(state.workspace.branch.marks()) if k > run.cursor]
        if ahead:
            state.seek(ahead[0])
            state.log.append(c.Seek(ahead[0]))
            return
    if run.is_done:
        if run.at_end and state.options.stage is None:
            state.message = OVER
        state.seek(run.length)
        state.log.append(c.SeekEnd())
        return
    state.running.goal = command.goal


def _run_to(state: State, command: c.RunTo) -> None:
    state.running.goal = command.length


def tick(state: State) -> Iteration | None:
    """One iteration towards the goal, or None if the run came to its end."""
    run, goal = state.run, state.running.goal
    if run.is_done or (isinstance(goal, int) and run.length >= goal):
        state.pause()
        return None
    run.seek(run.length)
    iteration = state.step()
    _pause_if_reached(state, iteration)
    return iteration


def _pause_if_reached(state: State, iteration: Iteration) -> None:
    run, goal = state.run, state.running.goal
    if isinstance(goal, int):
        if run.length >= goal:
            stage = state.browsing.stage_asked_for(goal)
            state.pause()
            if stage is not None:
                state.options = replace(state.options, stage=stage)
                state.log.append(c.SeekStage(run.cursor, stage))
        return
    reasons = hits(state.workspace.breakpoints, run.problem, iteration)
    if reasons and not run.is_done:
        names = labels_of(run.problem)
        where = f"iteration {iteration.index}" + (f", {names[iteration.instance_id]}" if len(names) > 1 else "")
        state.message = f"Breakpoint at {where}: {'; '.join(reasons)}"
        state.pause()
    elif goal == "event" and jumps([m for m in state.workspace.branch.marks() if m.iteration == iteration.index]):
        state.pause()


def _set_breakpoints(state: State, command: c.SetBreakpoints) -> None:
    state.workspace.breakpoints = with_changes(state.workspace.breakpoints, command.changes)


HANDLERS = {
    c.Step: step,
    c.StepStage: _step_stage,
    c.Back: lambda state, command: state.seek(max(state.run.cursor - 1, 0)),
    c.Seek: lambda state, command: state.seek(min(max(command.cursor, 0), state.run.length)),
    c.SeekStage: _seek_stage,
    c.SeekEnd: lambda state, command: state.seek(state.run.length),
    c.SeekEvent: _seek_event,
    c.RunUntil: _run_until,
    c.RunTo: _run_to,
    c.Pause: lambda state, command: state.pause(),
    c.Cancel: lambda state, command: state.pause(),
    c.UseHulls: lambda state, command: None,
    c.SetBreakpoints: _set_breakpoints,
}
