"""How a recording looks when it is opened: its views, where they stand, and where the 3D views look from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import rerun.blueprint as rrb

from verefine_viz.recording import entities
from verefine_viz.recording.film_tab import film_tab
from verefine_viz.recording.grasps import grasp_tab
from verefine_viz.recording.landscapes import landscape_tab
from verefine_viz.recording.layout import Layout

LEGEND_ARMS = 12
"""With more hypotheses a legend would hide the curves."""
MAP_TITLES = {
    "classes": "Pixel classes",
    "difference": "Δdepth",
    "angle": "Angle 0…90°",
    "f_d": "f_d 0…1",
    "f_n": "f_n 0…1",
    "rendered": "Rendered",
}
COLOUR_TITLES = {
    "correlation": "Correlation of colours ±2",
    "rendered_colour": "Model colour",
}
SCENE_MAP_TITLES = {name: MAP_TITLES[name] for name in ("classes", "difference", "rendered")}
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
"""Curves of a scene that are drawn object by object: those of several would run into each other in one view."""
DARK = (24, 26, 30)


def blueprint_of(
    layout: Layout,
    has_maps: bool,
    has_colour: bool = False,
    has_refiner: bool = False,
    has_grasps: bool = False,
    n_moments: Mapping[str, int] | None = None,
) -> rrb.Blueprint:
    """The whole window: an overview, and tabs for what has no room in it.

    Args:
        layout: what was recorded.
        has_maps: whether score maps are there,
        has_colour: those of colours,
        has_refiner: what a learned refiner saw,
        has_grasps: and grasps.
        n_moments: how many pictures each object's film has, by the name of its branch.
    """
    below = _curves(layout)
    overview = rrb.Vertical(
        rrb.Horizontal(
            _pictures(layout, has_maps),
            *([_maps(layout, has_colour, has_refiner)] if has_maps else []),
            _reason(layout),
            column_shares=[5, 4, 3] if has_maps else [6, 3],
        ),
        rrb.Horizontal(*below, _events(), column_shares=[*([8 / len(below)] * len(below)), 5]),
        row_shares=[3, 2],
        name="Scene" if layout.is_scene else "Object",
    )
    tabs = [
        overview,
        *([film_tab(n_moments)] if n_moments else []),
        *_scene_tabs(layout),
        *([landscape_tab(layout)] if has_maps else []),
    ]
    tabs += [grasp_tab(layout)] if has_grasps else []
    return rrb.Blueprint(
        rrb.Tabs(*tabs) if len(tabs) > 1 else overview,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        # The result is seen first; from there the user goes back.
        rrb.TimePanel(timeline=entities.TIMELINE, state="collapsed", play_state="following"),
        auto_views=False,
    )


def _scene_tabs(layout: Layout) -> list[rrb.Container]:
    """What only several objects have, a tab of the whole window each."""
    tabs: list[rrb.Container] = []
    if layout.is_scene:
        tabs.append(rrb.Tabs(*_curves_by_object(layout), name="Objects"))
    if layout.has_graph and layout.is_scene:
        graph = _graph(entities.GRAPH_OBJECTS, "Which object has to do with which")
        evidence = rrb.TextDocumentView(origin=entities.EVIDENCE, name="Evidence and order")
        tabs.append(rrb.Horizontal(graph, evidence, column_shares=[3, 2], name="Dependencies"))
    if layout.has_tree:
        tree = _graph(entities.TREE, "Search tree: hypothesis, visits, mean cost; white: this iteration")
        why = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
        tabs.append(
            rrb.Horizontal(tree, rrb.Vertical(_series("cost", layout), why), column_shares=[3, 2], name="Search tree")
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


def _pictures(layout: Layout, has_maps: bool) -> rrb.Container:
    views: list[rrb.View] = []
    if has_maps:
        on_photo = [f"+ {entities.IMAGE}", f"+ {entities.CONTOURS}/**"]
        views.append(rrb.Spatial2DView(origin=entities.CAMERA, contents=on_photo, name="Photo"))
    views.append(_scene(layout))
    if layout.is_scene:
        views.append(_answer(layout))
    if has_maps:
        with_masks = [f"+ {entities.IMAGE}", f"+ {entities.MASKS}"]
        views.append(rrb.Spatial2DView(origin=entities.CAMERA, contents=with_masks, name="Masks"))
        views.append(rrb.Spatial2DView(origin=entities.DEPTH, name="Depth"))
    return rrb.Tabs(*views)


def _scene(layout: Layout) -> rrb.Spatial3DView:
    # The mixed pose only starts the refiner, and what is best for the scene has a view of its own.
    hidden = [entities.stage(b, s) for b in layout.names for s in ("mixed", "incumbent")]
    overrides: dict[Any, Any] = {stage: rrb.EntityBehavior(visible=False) for stage in hidden}
    return rrb.Spatial3DView(
        origin="/",
        contents=[
            f"+ {entities.SCENE}/**",
            f"+ {entities.SUPPORT}/**",
            f"- {entities.IMAGE}",
            # Below a pinhole, a depth image would be drawn as points once more.
            f"- {entities.DEPTH}",
            f"- {entities.MASKS}",
            f"- {entities.CONTOURS}/**",
        ],
        name="Scene",
        background=DARK,
        overrides=overrides,
        eye_controls=_eye(layout),
    )


def _answer(layout: Layout) -> rrb.Spatial3DView:
    """The objects where the method says they are, so far: as the best scene, or each at its best."""
    stage = "incumbent" if layout.has_passes or layout.has_tree else "best"
    return rrb.Spatial3DView(
        origin="/",
        contents=[
            f"+ {entities.CLOUD}",
            f"+ {entities.SUPPORT}/**",
            *(f"+ {entities.stage(b, stage)}" for b in layout.names),
            *(f"+ {entities.poses(b)}" for b in layout.names),
        ],
        name="Answer so far",
        background=DARK,
        eye_controls=_eye(layout),
    )


def _eye(layout: Layout) -> rrb.EyeControls3D:
    """All 3D views begin at the same place."""
    return rrb.EyeControls3D(position=layout.eye_world, look_target=layout.center_world, eye_up=(0.0, 0.0, 1.0))


def _maps(layout: Layout, has_colour: bool, has_refiner: bool) -> rrb.Container:
    def pair(name: str, title: str) -> list[rrb.View]:
        return [
            rrb.Spatial2DView(origin=entities.pose_map(name, when), name=f"{title}, {when}")
            for when in entities.COMPARED
        ]

    observed = [
        rrb.Spatial2DView(origin=entities.OBSERVED_COLOUR, name="Observed colour"),
        rrb.Spatial2DView(origin=entities.OBSERVED_DEPTH, name="Observed depth"),
    ]
    first, second = [*MAP_TITLES.items()][:2], [*MAP_TITLES.items()][2:]
    tabs: list[rrb.Container | rrb.View] = [
        rrb.Grid(*observed, *(view for one in first for view in pair(*one)), grid_columns=2, name="Maps"),
        rrb.Grid(*(view for one in second for view in pair(*one)), grid_columns=2, name="Angles, fits, depth"),
    ]
    if has_colour:
        colours = [view for one in COLOUR_TITLES.items() for view in pair(*one)]
        tabs.append(rrb.Grid(*colours, grid_columns=2, name="Colour"))
    if has_refiner:
        saw = rrb.Spatial2DView(origin=entities.REFINER, name="Its steps")
        numbers = rrb.TextDocumentView(origin=entities.REFINER_WORDS, name="In numbers")
        tabs.append(rrb.Vertical(saw, numbers, row_shares=[3, 1], name="What the refiner saw"))
    if layout.has_passes:
        scene = [
            rrb.Spatial2DView(origin=entities.scene_map(name), name=title)
            for name, title in (SCENE_MAP_TITLES | (COLOUR_TITLES if has_colour else {})).items()
        ]
        tabs.append(rrb.Grid(*scene, grid_columns=2, name="Scene of the last pass"))
    return rrb.Tabs(*tabs)


def _events() -> rrb.Container:
    columns = rrb.archetypes.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    return rrb.Vertical(
        rrb.StateTimelineView(origin=entities.LANE, name="Object, hypothesis, accepted stage, event"),
        rrb.TextLogView(origin=entities.LOG, name="Events", columns=columns),
    )


def _reason(layout: Layout) -> rrb.Container | rrb.View:
    text = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
    if not layout.has_choice:
        return text
    bandit = rrb.Spatial2DView(origin=entities.BANDIT, name="UCB by hypothesis, from the lowest")
    return rrb.Vertical(text, bandit, row_shares=[3, 1])


def _curves(layout: Layout) -> list[rrb.Container]:
    """What stands below the scene: tabs of curves, one or two groups of them."""
    if layout.is_scene:
        left, right = ["best"], ["add_s"] if layout.has_ground_truth else []
        if layout.has_passes:
            left.insert(0, "scene")
        if layout.has_tree:
            left.insert(0, "cost")
        groups = [left, right] if right else [[name] for name in left]
    else:
        left = ["score", "ucb", "pulls"] if layout.has_choice else ["score"]
        right = ["error", "physics", "fit"] if layout.has_ground_truth else ["physics", "fit"]
        groups = [left, right]
    return [rrb.Tabs(*(_series(name, layout) for name in names)) for names in groups]


def _curves_by_object(layout: Layout) -> Iterator[rrb.Grid]:
    """A tab per group of curves, in it a view per object that has hypotheses."""
    for group in PER_OBJECT:
        names = [b.name for b in layout.branches if b.n_arms and (b.has_truth or group != "error")]
        if not names or (group == "ucb" and not layout.has_choice):
            continue
        legend = _legend(group, layout)
        views = (rrb.TimeSeriesView(origin=entities.curves(group, n), name=n, plot_legend=legend) for n in names)
        yield rrb.Grid(*views, name=CURVE_TITLES[group])


def _series(name: str, layout: Layout) -> rrb.View:
    """One of the kinds of curves."""
    return rrb.TimeSeriesView(
        origin=f"{entities.CURVES}/{name}", name=CURVE_TITLES[name], plot_legend=_legend(name, layout)
    )


def _legend(name: str, layout: Layout) -> rrb.PlotLegend:
    per_arm = name in ("score", "ucb", "pulls")
    # Where the curves of a good run are not at its end: scores rise, errors fall.
    corner = rrb.Corner2D.RightTop if name in ("error", "add_s", "physics", "cost") else rrb.Corner2D.RightBottom
    return rrb.PlotLegend(corner, visible=not per_arm or all(b.n_arms <= LEGEND_ARMS for b in layout.branches))
