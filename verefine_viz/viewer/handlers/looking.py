"""What is shown: the commands that change view options only."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, cast, get_args

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.session.engine import Run
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import MAP_NAMES
from verefine_viz.viewer.snapshot.partial_iteration import OF_ITERATION, is_answer
from verefine_viz.viewer.state.view_options import LAYERS, STAGES, ViewOptions

if TYPE_CHECKING:
    pass


def changed(look: ViewOptions, command: c.Command) -> ViewOptions | None:
    """The look after a command that only concerns the look; None for any other command.

    Raises:
        InputError: the command names a stage, map or layer that does not exist.
    """
    match command:
        case c.Focus(instance_id):
            return replace(look.unedited(), focus=instance_id, whole_scene=False, arm=None)
        case c.ShowScene():
            return replace(look.unedited(), focus=None, whole_scene=True, arm=None)
        case c.SelectArm(arm):
            return replace(look.unedited(), arm=arm)
        case c.Compare(a, b):
            for name in (a, b):
                if name is not None and name not in STAGES:
                    raise InputError(unknown("stage", name, STAGES))
            return replace(look, a=a or look.a, b=b or look.b, compared_before=None)
        case c.ShowMap(name):
            if name not in MAP_NAMES:
                raise InputError(unknown("map", name, MAP_NAMES))
            return replace(look, map=name)
        case c.ProbePixel(u, v):
            return replace(look, pixel=(u, v))
        case c.ColorCloud(by):
            kinds = get_args(c.CloudColors)
            following = kinds[(kinds.index(look.cloud) + 1) % len(kinds)]
            return replace(look, cloud=by or cast(c.CloudColors, following))
        case c.ShowLayer(name, visible):
            if name not in LAYERS:
                raise InputError(unknown("layer", name, LAYERS))
            on = name not in look.layers if visible is None else visible
            return replace(look, layers=look.layers | {name} if on else look.layers - {name})
        case c.ScrubPath(pose):
            return replace(look, path_pose=pose)
        case c.Animate(on):
            return replace(look, animate=on)
        case c.SortBatch(order):
            return replace(look, batch_order=order, batch_page=0)
        case c.FilterBatch(by, value):
            return replace(look, batch_only={**look.batch_only, by: value}, batch_page=0)
        case c.TurnPage(page):
            return replace(look, batch_page=max(page, 0))
        case c.ScoreGroundTruth():
            layers = look.layers | {"ground truth", "best"}
            return replace(look, a="best", b="ground truth", layers=layers)
    return None


def asked(look: ViewOptions | None, command: c.Command, run: Run, now: ViewOptions) -> ViewOptions | None:
    """The look after a command that may ask for something of the last iteration where its answer is shown (``now``)."""
    if look is None or run.iteration is None or not is_answer(run, now):
        return look
    last = run.iteration.stages[-1].name
    match command:
        case c.ShowLayer(name, visible) if name in OF_ITERATION and visible is not False:
            return replace(now, layers=now.layers | {name}, stage=last)
        case c.ShowLayer("best", visible) if visible is not True:
            return replace(now, layers=now.layers - {"best"}, stage=last)
        case c.Compare(a, b) if OF_ITERATION & {a, b}:
            return replace(look, stage=last)
    return look
