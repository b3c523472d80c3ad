"""Carries out grasps of the object in focus and chooses what of them is shown."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from verefine_viz.core.errors import InputError
from verefine_viz.viewer.grasp_commands import PlayGrasp, ShowGrasp, TryGrasp
from verefine_viz.viewer.snapshot.build import snapshot_of
from verefine_viz.viewer.state.state import State

if TYPE_CHECKING:
    from verefine_viz.grasping.grasp_answer import GraspPair


def _try(state: State, command: TryGrasp) -> None:
    snapshot = snapshot_of(state, deep=False)
    T_cam_obj = snapshot.T_cam_obj_grasped
    if T_cam_obj is None:
        raise InputError("there is no pose to grasp the object by; press Step first")
    instance_id = snapshot.target.instance.instance_id
    pair = state.grasps.carry_out(snapshot.problem, snapshot.session.grasp, instance_id, T_cam_obj)
    state.options = replace(state.options, grasp_by="pose", grasp_moment=_last(pair, "pose"))


def _show(state: State, command: ShowGrasp) -> None:
    if command.moment is None and command.by is None:
        state.options = replace(state.options, grasp_moment=None)
        return
    pair, by = _known(state), command.by or state.options.grasp_by
    moment = command.moment if command.moment is not None else _last(pair, by)
    if not 0 <= moment <= _last(pair, by):
        raise InputError(f"the grasp has no moment {moment}, expected 0 to {_last(pair, by)}")
    state.options = replace(state.options, grasp_by=by, grasp_moment=moment)


def _play(state: State, command: PlayGrasp) -> None:
    """Shows the last moment; the page animates those before it."""
    state.options = replace(state.options, grasp_moment=_last(_known(state), state.options.grasp_by))


def _known(state: State) -> GraspPair:
    pair = snapshot_of(state, deep=False).grasp
    if pair is None:
        raise InputError("no grasp was carried out here; press Grasp first")
    return pair


def _last(pair: GraspPair, by: str) -> int:
    path = (pair.answer if by == "pose" else pair.ground_truth).path
    return 0 if path is None else path.n_moments - 1


HANDLERS = {TryGrasp: _try, ShowGrasp: _show, PlayGrasp: _play}
