"""How a recording looks when it is opened: what a person needs first is largest."""

from __future__ import annotations

import rerun.blueprint as rrb

from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.maps import OBSERVED

MAP_TITLES = {
    OBSERVED: "Observed: colour | depth",
    "classes": "Pixel classes",
    "difference": "Δdepth ±2τ: blue = model behind, red = seen past it",
    "angle": "Normal angle 0…90°",
    "rendered": "Rendered depth",
    "f_d": "f_d, depth fit 0…1",
    "f_n": "f_n, normal fit 0…1",
}
CURVE_TITLES = {
    "score": "Score of each hypothesis",
    "ucb": "UCB",
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
    bottom = [_curves(layout), _events()]
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*top, _why(layout), column_shares=[5, 4, 3] if has_maps else [6, 3]),
            rrb.Horizontal(*bottom, column_shares=[3, 2]),
            row_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=entities.TIMELINE, state="collapsed"),
        auto_views=False,
    )


def _scene(layout: Layout) -> rrb.Container:
    hidden = rrb.EntityBehavior(visible=False)
    overrides = {}
    for branch in layout.branches:
        root = f"{entities.OBJECTS}/{branch.name}"
        overrides[f"{root}/stages/mixed"] = hidden
    contents = ["+ /scene/**", "+ /support/**", f"- {entities.DEPTH}", f"- {entities.MASKS}"]
    scene = rrb.Spatial3DView(origin="/", contents=contents, name="Scene", background=[24, 26, 30], overrides=overrides)
    camera = rrb.Spatial2DView(
        origin=entities.CAMERA,
        contents=[f"+ {entities.CAMERA}/**", f"- {entities.DEPTH}", f"+ {entities.OBJECTS}/**"],
        name="Camera",
    )
    depth = rrb.Spatial2DView(origin=entities.DEPTH, name="Depth")
    return rrb.Tabs(scene, camera, depth)


def _maps() -> rrb.Container:
    views = [rrb.Spatial2DView(origin=f"{entities.MAPS}/{name}", name=title) for name, title in MAP_TITLES.items()]
    return rrb.Grid(*views[:6], grid_columns=2, name="Left: simulated | right: refined")


def _curves(layout: Layout) -> rrb.Container:
    views = []
    for name, title in CURVE_TITLES.items():
        if name == "error" and not any(b.has_truth for b in layout.branches):
            continue
        views.append(rrb.TimeSeriesView(origin=f"{entities.CURVES}/{name}", name=title))
    return rrb.Grid(*views, grid_columns=3)


def _events() -> rrb.Container:
    return rrb.Vertical(
        rrb.StateTimelineView(origin=entities.LANE, name="Object, hypothesis, kept stage, event"),
        rrb.TextLogView(origin=entities.LOG, name="Events"),
    )


def _why(layout: Layout) -> rrb.Container:
    text = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
    bandit = rrb.BarChartView(origin=entities.BANDIT, name="UCB of each hypothesis when it was chosen")
    return rrb.Vertical(text, bandit, row_shares=[3, 1])
