"""Where the views of a recording stand in the window: what a person needs first is largest."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rerun.blueprint as rrb

from verefine_viz.recording import entities
from verefine_viz.recording.curve_views import curves, curves_by_object, series
from verefine_viz.recording.maps import OBSERVED
from verefine_viz.recording.shown import Shown

MAP_TITLES = {
    OBSERVED: "Observed: colour | depth",
    "classes": "Pixel classes",
    "difference": "Δdepth ±2τ",
    "angle": "Angle 0…90°",
    "f_d": "f_d, depth fit 0…1",
    "f_n": "f_n, normal fit 0…1",
    "rendered": "Rendered depth",
}
SCENE_MAP_TITLES = {
    "classes": "Pixel classes",
    "difference": "Δdepth ±2τ",
    "rendered": "Rendered depth",
}


def arranged(spatial: Sequence[rrb.Spatial3DView], what: Shown) -> rrb.Blueprint:
    """The whole window: an overview, and a tab for each thing that only several objects have."""
    below = curves(what)
    overview = rrb.Vertical(
        rrb.Horizontal(
            _pictures(spatial, what),
            *([_maps(what)] if what.has_maps else []),
            _why(what),
            column_shares=[5, 4, 3] if what.has_maps else [6, 3],
        ),
        rrb.Horizontal(*below, _events(), column_shares=[*([8 / len(below)] * len(below)), 5]),
        row_shares=[3, 2],
        name="Scene" if what.is_scene else "Object",
    )
    tabs = [overview, *_scene_tabs(what)]
    return rrb.Blueprint(
        rrb.Tabs(*tabs) if len(tabs) > 1 else overview,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        # What it came to is seen first; from there a person goes back.
        rrb.TimePanel(timeline=entities.TIMELINE, state="collapsed", play_state="following"),
        auto_views=False,
    )


def _scene_tabs(what: Shown) -> list[rrb.Container]:
    """What only several objects have, a tab of the whole window each."""
    tabs: list[rrb.Container] = []
    if what.is_scene:
        tabs.append(rrb.Tabs(*curves_by_object(what), name="Objects"))
    if what.has_graph:
        graph = _graph(f"{entities.GRAPH}/objects", "Which object has to do with which")
        evidence = rrb.TextDocumentView(origin=entities.EVIDENCE, name="Evidence and order")
        tabs.append(rrb.Horizontal(graph, evidence, column_shares=[3, 2], name="Dependencies"))
    if what.has_tree:
        tree = _graph(entities.TREE, "Search tree: hypothesis, visits, mean cost; white: this iteration")
        why = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
        tabs.append(
            rrb.Horizontal(tree, rrb.Vertical(series("cost", what), why), column_shares=[3, 2], name="Search tree")
        )
    return tabs


def _graph(origin: str, name: str) -> rrb.GraphView:
    """Nodes stay where they were put."""
    return rrb.GraphView(
        origin=origin,
        name=name,
        force_link=rrb.archetypes.ForceLink(enabled=False),
        force_many_body=rrb.archetypes.ForceManyBody(enabled=False),
        force_position=rrb.archetypes.ForcePosition(enabled=False),
        force_center=rrb.archetypes.ForceCenter(enabled=False),
    )


def _hidden(what: Shown) -> dict[Any, Any]:
    # The mixed pose only starts the refiner, and what is best for the scene has a view of its own.
    stages = [f"{entities.OBJECTS}/{b}/stages/{s}" for b in what.branches for s in ("mixed", "incumbent")]
    return {stage: rrb.EntityBehavior(visible=False) for stage in stages}


def spatial_views(what: Shown) -> list[rrb.Spatial3DView]:
    """The 3D views, made first since messages about the eye name them."""
    return [_scene(what), _answer(what)] if what.is_scene else [_scene(what)]


def _scene(what: Shown) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
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
        overrides=_hidden(what),
    )


def _answer(what: Shown) -> rrb.Spatial3DView:
    """The objects where the method says they are, so far: as the best scene, or each at its best."""
    stage = "incumbent" if what.has_passes or what.has_tree else "best"
    return rrb.Spatial3DView(
        origin="/",
        contents=[
            f"+ {entities.CLOUD}",
            f"+ {entities.SUPPORT}/**",
            *(f"+ {entities.OBJECTS}/{b}/stages/{stage}" for b in what.branches),
            *(f"+ {entities.OBJECTS}/{b}/poses" for b in what.branches),
        ],
        name="Answer so far",
        background=[24, 26, 30],
    )


def _pictures(spatial: Sequence[rrb.Spatial3DView], what: Shown) -> rrb.Container:
    views: list[rrb.View] = [*spatial]
    if what.has_maps:
        views.append(
            rrb.Spatial2DView(
                origin=entities.CAMERA, contents=[f"+ {entities.IMAGE}", f"+ {entities.MASKS}"], name="Camera"
            )
        )
        views.append(rrb.Spatial2DView(origin=entities.DEPTH, name="Depth"))
    return rrb.Tabs(*views)


def _maps(what: Shown) -> rrb.Container:
    views = [rrb.Spatial2DView(origin=f"{entities.MAPS}/{name}", name=title) for name, title in MAP_TITLES.items()]
    tabs: list[rrb.Container | rrb.View] = [
        rrb.Grid(*views[:6], grid_columns=2, name="Maps: simulated | refined"),
        *views[6:],
    ]
    if what.has_passes:
        scene = [
            rrb.Spatial2DView(origin=f"{entities.SCENE_MAPS}/{name}", name=title)
            for name, title in SCENE_MAP_TITLES.items()
        ]
        tabs.append(rrb.Grid(*scene, grid_columns=2, name="Scene of the last pass"))
    return rrb.Tabs(*tabs)


def _events() -> rrb.Container:
    columns = rrb.archetypes.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    return rrb.Vertical(
        rrb.StateTimelineView(origin=entities.LANE, name="Object, hypothesis, kept stage, event"),
        rrb.TextLogView(origin=entities.LOG, name="Events", columns=columns),
    )


def _why(what: Shown) -> rrb.Container | rrb.View:
    text = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
    if not what.has_choice:
        return text
    bandit = rrb.BarChartView(
        origin=entities.BANDIT, name="UCB by hypothesis, above the lowest", plot_legend=rrb.PlotLegend(visible=False)
    )
    return rrb.Vertical(text, bandit, row_shares=[3, 1])
