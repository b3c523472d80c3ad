"""Edits a pose, and continues the run from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import as_rigid
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.build import snapshot_of, state_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.state.state import State, Unconfirmed

CAN_CONTINUE = (
    "Drag the arrows and rings in 3D, or type numbers; then press “Continue from here” in the Physics tab, or “Cancel” "
    "to leave the pose as it was."
)

ONLY_SCORED = (
    "Drag the arrows and rings in 3D, or type numbers, to see how poses score. No iteration is left here to go on from "
    "one: for that, press “Cancel”, go back on the timeline, then edit."
)

CANCEL = c.EditPose(False)


def refuse_loss(state: State, command: c.Command) -> None:
    """Passes where no pose was moved, or ``command`` does not drop it, or drops it on purpose.

    Raises:
        Unconfirmed: the moved pose would be lost.
    """
    if not state.options.is_moved or command.keeps_edited_pose or command == CANCEL:
        return
    if state.edit_hint == CAN_CONTINUE:
        lost = (
            "The pose that you moved would be lost: no run goes on from it yet. Press “Cancel” in the Physics tab "
            "to leave it as it was, or"
        )
        raise Unconfirmed(lost, "continue from here", c.ForkFromPose())
    lost = "The pose that you moved would be lost: no run can go on from it here. When you have seen enough,"
    raise Unconfirmed(lost, "let it go", CANCEL)


def _edit(state: State, command: c.EditPose) -> None:
    if not command.on:
        state.options = state.options.unedited()
        return
    snapshot = snapshot_of(state, deep=False)
    if snapshot.state is None:
        raise InputError(f"{snapshot.name} has no hypothesis whose pose could be edited")
    arms = snapshot.state.arms
    T = arms[min(snapshot.arm, len(arms) - 1)].current.T_cam_obj
    state.options = state.options.editing(tuple(float(x) for x in T.ravel()), snapshot.arm)
    state.edit_hint = state.message = _hint_for(state, snapshot, T)


def _hint_for(state: State, snapshot: Snapshot, T_cam_obj: Float) -> str:
    """What can be done with a moved pose of the object in focus; the method itself is asked for iterations."""
    if state.workspace.branch.recording is not None:
        return CAN_CONTINUE  # Asking would compute the run again.
    run = state.run
    tried = run.fork(run.cursor, edit=(snapshot.target.instance.instance_id, snapshot.arm, T_cam_obj))
    return CAN_CONTINUE if state_of(tried.state, snapshot.target).edited_arms else ONLY_SCORED


def _edit_at(state: State, T_cam_obj: Float | None) -> None:
    """Edits the pose of the landscape that was clicked; refused where there is none."""
    if T_cam_obj is None:
        raise InputError("there is no such pose: the score around the best pose is not known here")
    if state.options.edited is None:
        _edit(state, c.EditPose())
    _drag(state, c.DragPose(tuple(float(x) for x in T_cam_obj.ravel())))


def _edit_on_curve(state: State, command: c.EditPoseOnCurve) -> None:
    around, T = snapshot_of(state, deep=False).landscape, None
    if around is not None and 0 <= command.curve < len(around.curves):
        curve = around.curves[command.curve]
        if 0 <= command.u < len(curve.offsets):
            T = curve.axis.moved(around.T_cam_obj, float(curve.offsets[command.u]))
    _edit_at(state, T)


def _edit_in_slice(state: State, command: c.EditPoseInSlice) -> None:
    snapshot, T = snapshot_of(state, deep=False), None
    two, around = snapshot.score_slice, snapshot.landscape
    if two is not None and around is not None and 0 <= command.u < len(two.scores) > command.v >= 0:
        T = two.pose(around.T_cam_obj, command.u, len(two.scores) - 1 - command.v)
    _edit_at(state, T)


def _edit_other(state: State, command: c.EditOtherPose) -> None:
    other = snapshot_of(state, deep=False).other_pose
    _edit_at(state, None if other is None else other.T_cam_obj)


def _drag(state: State, command: c.DragPose) -> None:
    if state.options.edited is None:
        raise InputError("no pose is being edited; press Edit pose first")
    T_cam_obj = command.T_cam_obj
    T = as_rigid(np.reshape(T_cam_obj, (4, 4)) if len(T_cam_obj) == 16 else T_cam_obj, "edited pose")
    state.options = replace(state.options, edited=tuple(float(x) for x in T.ravel()))
    state.message = state.edit_hint


def _fork_from_pose(state: State, command: c.ForkFromPose) -> None:
    T, snapshot = state.options.T_cam_obj_edited, snapshot_of(state, deep=False)
    if T is None:
        raise InputError("no pose is being edited; press Edit pose first")
    run, instance_id = state.run, snapshot.target.instance.instance_id
    hint = _hint_for(state, snapshot, T)
    if hint == ONLY_SCORED:
        label = snapshot.scene.object(instance_id).label
        raise InputError(
            f"no iteration is left for {label} at iteration {run.cursor}, so nothing could go on from the moved "
            "pose; press “Cancel”, go back on the timeline, then edit"
        )
    if hint == CAN_CONTINUE and not state.options.is_moved:
        raise InputError(
            "the pose was not moved yet; drag its arrows and rings in 3D or type numbers first, or press “Cancel”"
        )
    state.workspace.fork(run.cursor, (), (instance_id, snapshot.arm, T))
    state.options = replace(state.options.moved(), focus=instance_id, arm=snapshot.arm)
    state.message = _continued(snapshot_of(state, deep=False))


def _continued(snapshot: Snapshot) -> str:
    """What becomes of the pose that was just put there, of the hypothesis in focus."""
    label, several = snapshot.scene.object(snapshot.target.instance.instance_id).label, len(snapshot.scene.objects) > 1
    who = f"Hypothesis {snapshot.arm + 1}" + (f" of {label}" if several else "")
    score = snapshot.state.arms[snapshot.arm].current.score.score
    takes_turns = several and method_of(snapshot.session.method.name).takes_turns
    when = f"as soon as {label} is next in turn" if takes_turns else "next"
    return f"{who} goes on from where you put it, with a score of {score:.3f}. Step or Run: it is refined {when}."


HANDLERS = {
    c.EditPose: _edit,
    c.EditPoseOnCurve: _edit_on_curve,
    c.EditPoseInSlice: _edit_in_slice,
    c.EditOtherPose: _edit_other,
    c.DragPose: _drag,
    c.ForkFromPose: _fork_from_pose,
}
