"""Edits a pose by hand, and continues the run from it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import as_rigid
from verefine_viz.viewer import commands as c
from verefine_viz.viewer import comparison_commands as s
from verefine_viz.viewer.commands import Command
from verefine_viz.viewer.snapshot.build import state_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot

if TYPE_CHECKING:
    from verefine_viz.viewer.debugger import Debugger


# What is not done before a person has confirmed it, and what could not be done.


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


BY_HAND = (
    "Drag the arrows and rings in 3D, or type numbers; then press “Continue from here” in the Physics tab, or “Cancel” "
    "to leave the pose as it was."
)

TO_TRY = (
    "Drag the arrows and rings in 3D, or type numbers, to see how poses score. No iteration is left here to go on from "
    "one: for that, press “Cancel”, go back on the timeline, then edit."
)

READ = (
    "Drag the arrows and rings in 3D, or type numbers, to see how poses score. This run was read from a file, and "
    "cannot go on from one: for that, press “Cancel”, then “Restart” to run it here, then edit."
)

CANCEL = c.EditPose(False)

_LEAVES_IT = (
    c.DragPose | c.ForkFromPose | c.Pause | c.Cancel | c.Compare | c.ShowMap | c.ProbePixel | c.ColorCloud
    | c.ShowLayer | c.ScrubPath | c.PlayPath | c.Animate | c.SetBreakpoints | c.SortBatch | c.FilterBatch | c.TurnPage
    | c.ScoreGroundTruth | c.SaveSession | c.Export | s.CompareRun | s.CompareBranch | s.CompareRecording | s.RunB
    | s.PauseB | s.StopComparing | s.ShowSide | s.ShowSidePoses
)  # fmt: skip
"""What leaves the pose under the hand as it is."""

WITH_PASSES = ("vf_depth", "physim_mcts")
"""Methods in which an object may have to wait for others before it is placed."""


class Posing:
    """The pose that the debugger's person moves by hand."""

    def __init__(self, debugger: Debugger) -> None:
        self._debugger = debugger
        self._hint = BY_HAND
        """What can be done with the pose that is edited."""

    def refuse_loss(self, command: Command) -> None:
        """Passes where no pose was moved, or ``command`` does not drop it, or drops it on purpose.

        Raises:
            Unconfirmed: the moved pose would be lost.
        """
        if not self._debugger.look.is_moved or isinstance(command, _LEAVES_IT) or command == CANCEL:
            return
        if self._hint == BY_HAND:
            said = (
                "The pose that you moved would be lost: no run goes on from it yet. Press “Cancel” in the Physics tab "
                "to leave it as it was, or"
            )
            raise Unconfirmed(said, "continue from here", c.ForkFromPose())
        said = "The pose that you moved would be lost: no run can go on from it here. When you have seen enough,"
        raise Unconfirmed(said, "let it go", CANCEL)

    def do(self, command: Command) -> bool:
        """Carries out a command about the edited pose; False where it is about something else."""
        match command:
            case c.EditPose(on):
                self._edit(on)
            case c.DragPose(T_cam_obj):
                self._drag(T_cam_obj)
            case c.ForkFromPose():
                self._fork()
            case _:
                return False
        return True

    def _edit(self, on: bool) -> None:
        debugger = self._debugger
        if not on:
            debugger.look = debugger.look.unedited()
            return
        view = debugger.view(deep=False)
        if view.state is None:
            raise InputError(f"{view.name} has no hypothesis whose pose could be edited")
        arms = view.state.arms
        T = arms[min(view.arm, len(arms) - 1)].current.T_cam_obj
        edited = tuple(float(x) for x in T.ravel())
        debugger.look = debugger.look.editing(edited, view.arm)
        self._hint = self._hint_for(view, T)
        debugger.message = self._hint

    def _hint_for(self, view: Snapshot, T_cam_obj: Float) -> str:
        """What can be done with a moved pose of the object in focus; the method itself is asked for iterations."""
        if self._debugger.workspace.branch.recording is not None:
            return READ
        run = self._debugger.workspace.run
        tried = run.fork(run.cursor, edit=(view.target.instance.instance_id, view.arm, T_cam_obj))
        return BY_HAND if state_of(tried.state, view.target).by_hand else TO_TRY

    def _drag(self, T_cam_obj: c.Pose) -> None:
        debugger = self._debugger
        if debugger.look.edited is None:
            raise InputError("no pose is being edited; press Edit pose first")
        T = as_rigid(np.reshape(T_cam_obj, (4, 4)) if len(T_cam_obj) == 16 else T_cam_obj, "edited pose")
        debugger.look = replace(debugger.look, edited=tuple(float(x) for x in T.ravel()))
        debugger.message = self._hint

    def _fork(self) -> None:
        debugger = self._debugger
        T, view = debugger.look.T_cam_obj_edited, debugger.view(deep=False)
        if T is None:
            raise InputError("no pose is being edited; press Edit pose first")
        run, instance_id = debugger.workspace.run, view.target.instance.instance_id
        hint = self._hint_for(view, T)
        if hint == TO_TRY:
            label = view.scene.object(instance_id).label
            raise InputError(
                f"no iteration is left for {label} at iteration {run.cursor}, so nothing could go on from the moved "
                "pose; press “Cancel”, go back on the timeline, then edit"
            )
        if hint == BY_HAND and not debugger.look.is_moved:
            raise InputError(
                "the pose was not moved yet; drag its arrows and rings in 3D or type numbers first, or press “Cancel”"
            )
        debugger.workspace.fork(run.cursor, (), (instance_id, view.arm, T))
        debugger.look = replace(debugger.look.moved(), focus=instance_id, arm=view.arm)
        debugger.message = continued(debugger.view(deep=False))


def continued(view: Snapshot) -> str:
    """What becomes of the pose that was just put there, hypothesis ``view.arm`` of the object in focus."""
    label = view.scene.object(view.target.instance.instance_id).label
    who = f"Hypothesis {view.arm + 1}" + (f" of {label}" if len(view.scene.objects) > 1 else "")
    score = view.state.arms[view.arm].current.score.score
    when = "next"
    if view.session.method.name in WITH_PASSES and len(view.scene.objects) > 1:
        when = f"as soon as {label} is next in turn"
    return f"{who} goes on from where you put it, with a score of {score:.3f}. Step or Run: it is refined {when}."
