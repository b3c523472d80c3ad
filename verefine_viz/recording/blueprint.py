"""How a recording looks when it is opened: what a person needs first is largest."""

from __future__ import annotations

from typing import Any

import rerun.blueprint as rrb

from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.maps import OBSERVED

MAP_TITLES = {
    OBSERVED: "Observed: colour | depth",
    "classes": "Pixel classes",
    "difference": "Δdepth ±2τ",
    "angle": "Angle 0…90°",
    "f_d": "f_d, depth fit 0…1",
    "f_n": "f_n, normal fit 0…1",
    "rendered": "Rendered depth",
}
CURVE_TITLES = {
    "score": "Score of each hypothesis",
    "ucb": "UCB of each hypothesis",
    "pulls": "Pulls",
    "fit": "Fit of the two candidates",
    "error": "Error against ground truth",
    "physics": "Simulation and refiner",
}


def make_blueprint(layout: Layout, has_maps: bool) -> rrb.Blueprint:
    """The blueprint that is embedded in the recording."""
    top: list[rrb.Container | rrb.View] = [_scene(layout)]
    if has_maps:
        top.append(_maps())
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*top, _why(), column_shares=[5, 4, 3] if has_maps else [6, 3]),
            rrb.Horizontal(*_curves(layout), _events(), column_shares=[4, 4, 5]),
            row_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=entities.TIMELINE, state="collapsed"),
        auto_views=False,
    )


def _scene(layout: Layout) -> rrb.Container:
    # The mixed pose only starts the refiner; it would hide the others.
    hidden: dict[Any, Any] = {
        f"{entities.OBJECTS}/{b.name}/stages/mixed": rrb.EntityBehavior(visible=False) for b in layout.branches
    }
    scene = rrb.Spatial3DView(
        origin="/",
        contents=[
            f"+ {entities.SCENE}/**",
            f"+ {entities.SUPPORT}/**",
            f"- {entities.IMAGE}",
            # Below a pinhole, a depth image would be drawn as points once more.
            f"- {entities.DEPTH}",
            f"- {entities.MASKS}",
        ],
        name="Scene",
        background=[24, 26, 30],
        overrides=hidden,
        eye_controls=rrb.EyeControls3D(
            position=layout.eye_world, look_target=layout.center_world, eye_up=(0.0, 0.0, 1.0)
        ),
    )
    camera = rrb.Spatial2DView(
        origin=entities.CAMERA,
        contents=[f"+ {entities.CAMERA}/**", f"- {entities.DEPTH}", f"+ {entities.OBJECTS}/**"],
        name="Camera",
        overrides=hidden,
    )
    depth = rrb.Spatial2DView(origin=entities.DEPTH, name="Depth")
    return rrb.Tabs(scene, camera, depth)


def _maps() -> rrb.Container:
    views = [rrb.Spatial2DView(origin=f"{entities.MAPS}/{name}", name=title) for name, title in MAP_TITLES.items()]
    return rrb.Tabs(rrb.Grid(*views[:6], grid_columns=2, name="Maps: simulated | refined"), *views[6:])


def _curves(layout: Layout) -> list[rrb.Container]:
    views = {
        name: rrb.TimeSeriesView(
            origin=f"{entities.CURVES}/{name}", name=title, plot_legend=rrb.PlotLegend(rrb.Corner2D.RightBottom)
        )
        for name, title in CURVE_TITLES.items()
    }
    left = [views["score"], views["ucb"], views["pulls"]]
    right = [views["physics"], views["fit"]]
    if any(b.has_truth for b in layout.branches):
        right.insert(0, views["error"])
    return [rrb.Tabs(*left), rrb.Tabs(*right)]


def _events() -> rrb.Container:
    return rrb.Vertical(
        rrb.StateTimelineView(origin=entities.LANE, name="Object, hypothesis, kept stage, event"),
        rrb.TextLogView(origin=entities.LOG, name="Events"),
    )


def _why() -> rrb.Container:
    text = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
    bandit = rrb.BarChartView(origin=entities.BANDIT, name="UCB of each hypothesis when it was chosen")
    return rrb.Vertical(text, bandit, row_shares=[3, 1])
