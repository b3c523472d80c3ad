"""Commands that change view options only: what is shown, of what, in which colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast, get_args

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.scores import MAP_NAMES
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.snapshot.build import snapshot_of
from verefine_viz.viewer.snapshot.partial_iteration import OF_ITERATION, is_answer
from verefine_viz.viewer.state.state import State
from verefine_viz.viewer.state.view_options import LAYERS, STAGES, ViewOptions


def look(state: State, command: c.Command) -> None:
    """Carries out a command that changes view options only.

    Raises:
        InputError: the command names a stage, map, layer, instance or pixel that does not exist.
    """
    options = _of_last_iteration(_CHANGES[type(command)](state.options, command), command, state)
    problem = state.workspace.work.problem
    ids = [i.instance_id for i in problem.instances]
    if options.focus is not None and options.focus not in ids:
        raise InputError(unknown("instance", options.focus, ids))
    if options.pixel is not None:
        h, w = problem.observation.camera.shape
        if not (0 <= options.pixel[0] < w and 0 <= options.pixel[1] < h):
            raise InputError(f"pixel {options.pixel} is outside of the {w}×{h} image")
    state.options = options


def show_layer(state: State, command: c.ShowLayer) -> None:
    """A layer on or off; one that a comparison hides comes back if it is asked for."""
    choice = state.comparison.choice
    if choice is not None and command.name in choice.hidden and command.visible is not False:
        state.workspace.work.comparison = replace(choice, hidden=choice.hidden - {command.name})
        state.options = replace(state.options, layers=state.options.layers | {command.name})
    else:
        look(state, command)


def play_path(state: State, command: c.PlayPath) -> None:
    """Shows the last pose of the simulated path; the page animates it."""
    shown = snapshot_of(state, deep=False).shown
    if shown is None or shown.path is None:
        raise InputError("no simulated path here; step to an iteration with physics")
    options = state.options
    state.options = replace(options, path_pose=len(shown.path.Ts_cam_obj) - 1, layers=options.layers | {"path"})


def _compare(options: ViewOptions, command: c.Compare) -> ViewOptions:
    for name in (command.a, command.b):
        if name is not None and name not in STAGES:
            raise InputError(unknown("stage", name, STAGES))
    return replace(options, a=command.a or options.a, b=command.b or options.b, compared_before=None)


def _show_map(options: ViewOptions, command: c.ShowMap) -> ViewOptions:
    if command.name not in MAP_NAMES:
        raise InputError(unknown("map", command.name, MAP_NAMES))
    return replace(options, map=command.name)


def _color_cloud(options: ViewOptions, command: c.ColorCloud) -> ViewOptions:
    kinds = get_args(c.CloudColors)
    following = kinds[(kinds.index(options.cloud) + 1) % len(kinds)]
    return replace(options, cloud=command.by or cast(c.CloudColors, following))


def _show_layer(options: ViewOptions, command: c.ShowLayer) -> ViewOptions:
    if command.name not in LAYERS:
        raise InputError(unknown("layer", command.name, LAYERS))
    on = command.name not in options.layers if command.visible is None else command.visible
    return replace(options, layers=options.layers | {command.name} if on else options.layers - {command.name})


def _score_ground_truth(options: ViewOptions, command: c.ScoreGroundTruth) -> ViewOptions:
    return replace(options, a="best", b="ground truth", layers=options.layers | {"ground truth", "best"})


_CHANGES: dict[type[c.Command], Callable[[ViewOptions, Any], ViewOptions]] = {
    c.Focus: lambda o, x: replace(o.unedited(), focus=x.instance_id, whole_scene=False, arm=None),
    c.ShowScene: lambda o, x: replace(o.unedited(), focus=None, whole_scene=True, arm=None),
    c.SelectArm: lambda o, x: replace(o.unedited(), arm=x.arm),
    c.Compare: _compare,
    c.ShowMap: _show_map,
    c.ProbePixel: lambda o, x: replace(o, pixel=(x.u, x.v)),
    c.ColorCloud: _color_cloud,
    c.ShowLayer: _show_layer,
    c.ScrubPath: lambda o, x: replace(o, path_pose=x.pose),
    c.Animate: lambda o, x: replace(o, animate=x.on),
    c.SortBatch: lambda o, x: replace(o, batch_order=x.order, batch_page=0),
    c.FilterBatch: lambda o, x: replace(o, batch_only={**o.batch_only, x.by: x.value}, batch_page=0),
    c.TurnPage: lambda o, x: replace(o, batch_page=max(x.page, 0)),
    c.ScoreGroundTruth: _score_ground_truth,
}
"""By command: the options after it."""


def _of_last_iteration(options: ViewOptions, command: c.Command, state: State) -> ViewOptions:
    """``options``, or those that show the last iteration where its answer is shown and ``command`` asks for a pose of
    the iteration.
    """
    run, now = state.run, state.options
    if run.iteration is None or not is_answer(run, now):
        return options
    last = run.iteration.stages[-1].name
    match command:
        case c.ShowLayer(name, visible) if name in OF_ITERATION and visible is not False:
            return replace(now, layers=now.layers | {name}, stage=last)
        case c.ShowLayer("best", visible) if visible is not True:
            return replace(now, layers=now.layers - {"best"}, stage=last)
        case c.Compare(a, b) if OF_ITERATION & {a, b}:
            return replace(options, stage=last)
    return options


HANDLERS = {**dict.fromkeys(_CHANGES, look), c.ShowLayer: show_layer, c.PlayPath: play_path}
