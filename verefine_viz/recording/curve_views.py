"""The views of a recording that hold curves."""

from __future__ import annotations

from collections.abc import Iterator

import rerun.blueprint as rrb

from verefine_viz.recording import entities
from verefine_viz.recording.shown import Shown

CURVE_TITLES = {
    "score": "Score of each hypothesis",
    "ucb": "UCB of each hypothesis",
    "pulls": "Pulls",
    "fit": "Fit of the two candidates",
    "error": "Error against ground truth",
    "physics": "Simulation and refiner",
    "scene": "Score of the scene",
    "best": "Best score of each object",
    "add_s": "ADD(-S) of each object's best pose [mm]",
    "cost": "Cost of the scene",
}
PER_OBJECT = ("score", "ucb", "error", "physics")
"""Curves of a scene that are drawn object by object: those of several in one view could not be told apart."""


def curves(what: Shown) -> list[rrb.Container]:
    """What stands below the scene: tabs of curves, one or two groups of them."""
    if what.is_scene:
        left, right = ["best"], ["add_s"] if what.has_truth else []
        if what.has_passes:
            left.insert(0, "scene")
        if what.has_tree:
            left.insert(0, "cost")
        groups = [left, right] if right else [[name] for name in left]
    else:
        left = ["score", "ucb", "pulls"] if what.has_choice else ["score"]
        right = ["error", "physics", "fit"] if what.has_truth else ["physics", "fit"]
        groups = [left, right]
    return [rrb.Tabs(*(series(name, what) for name in names)) for names in groups]


def curves_by_object(what: Shown) -> Iterator[rrb.Grid]:
    """A tab per group of curves, in it a view per object."""
    for group in PER_OBJECT:
        if (group == "ucb" and not what.has_choice) or (group == "error" and not what.has_truth):
            continue
        views = (
            rrb.TimeSeriesView(
                origin=f"{entities.CURVES}/{group}/{branch}", name=branch, plot_legend=_legend(what, group)
            )
            for branch in what.worked_on
        )
        yield rrb.Grid(*views, name=CURVE_TITLES[group])


def series(name: str, what: Shown) -> rrb.View:
    """One of the kinds of curves."""
    return rrb.TimeSeriesView(
        origin=f"{entities.CURVES}/{name}", name=CURVE_TITLES[name], plot_legend=_legend(what, name)
    )


def _legend(what: Shown, name: str) -> rrb.PlotLegend:
    per_arm = name in ("score", "ucb", "pulls")
    # Where the curves of a good run are not at its end: scores rise, errors fall.
    corner = rrb.Corner2D.RightTop if name in ("error", "add_s", "physics", "cost") else rrb.Corner2D.RightBottom
    return rrb.PlotLegend(corner, visible=what.has_legend or not per_arm)
