"""How a recording looks when it is opened: what a person needs first is largest."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.recording import entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.maps import OBSERVED
from verefine_viz.recording.rrd_file import messages

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
    "classes": "Pixel classes of the scene",
    "difference": "Δdepth ±2τ",
    "rendered": "Rendered depth",
}
CURVE_TITLES = {
    "score": "Score of each hypothesis",
    "ucb": "UCB of each hypothesis",
    "pulls": "Pulls",
    "fit": "Fit of the two candidates",
    "error": "Error against ground truth",
    "physics": "Simulation and refiner",
    "scene": "Score of the scene",
    "best": "Best score of each object",
    "cost": "Cost of the scene",
}
LEGEND_ARMS = 12
"""With more hypotheses a legend would hide the curves."""


@dataclass(frozen=True)
class Shown:
    """What there is to be shown; recordings that agree in it share their views."""

    branches: tuple[str, ...]
    has_truth: bool
    has_maps: bool
    has_graph: bool
    has_passes: bool
    has_tree: bool
    has_legend: bool

    @property
    def is_scene(self) -> bool:
        """Whether there is more than one object."""
        return len(self.branches) > 1


def shown(layout: Layout, has_maps: bool) -> Shown:
    """What a recording of that layout has to show."""
    branches = layout.branches
    return Shown(
        branches=tuple(b.name for b in branches),
        has_truth=any(b.has_truth for b in branches),
        has_maps=has_maps,
        has_graph=layout.has_graph,
        has_passes=layout.method == "vf_depth",
        has_tree=layout.method == "physim_mcts",
        has_legend=all(b.n_arms <= LEGEND_ARMS for b in branches),
    )


def blueprint_of(layout: Layout, has_maps: bool) -> rrb.Blueprint:
    """The blueprint of a recording."""
    what = shown(layout, has_maps)
    scene = _scene(what)
    return _WithEye(_all_views(scene, what), scene, layout)


def blueprint_messages(layout: Layout, has_maps: bool) -> bytes:
    """The same as messages for :meth:`RrdFile.close`."""
    return _prepared(shown(layout, has_maps)).messages(layout)


class _WithEye(rrb.Blueprint):
    def __init__(self, views: rrb.Blueprint, scene: rrb.Spatial3DView, layout: Layout) -> None:
        super().__init__()
        self._views, self._scene, self._layout = views, scene, layout

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._views._log_to_stream(stream)
        stream.log(_eye_path(self._scene), _eye(self._layout))


class _Prepared(rrb.Blueprint):
    """Views as rerun's messages, made once; only the eye differs from frame to frame.

    The stream that made the views stays open, as the eye's message must name the same blueprint.
    """

    def __init__(self, what: Shown) -> None:
        super().__init__()
        self._scene = _scene(what)
        self._what = what
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "views.rbl"
            self.save(entities.APPLICATION, path)
            self._stream.flush()
            self._views = messages(path.read_bytes())
            self._bytes = self._stream.binary_stream()

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        _all_views(self._scene, self._what)._log_to_stream(stream)
        self._stream = stream

    def messages(self, layout: Layout) -> bytes:
        self._stream.log(_eye_path(self._scene), _eye(layout))
        # The views come first: they introduce the blueprint that the eye belongs to.
        return self._views + messages(self._bytes.read() or b"")


_prepared = lru_cache(maxsize=32)(_Prepared)


def _eye_path(scene: rrb.Spatial3DView) -> str:
    return f"{scene.blueprint_path()}/EyeControls3D"


def _eye(layout: Layout) -> rrb.EyeControls3D:
    return rrb.EyeControls3D(position=layout.eye_world, look_target=layout.center_world, eye_up=(0.0, 0.0, 1.0))


def _all_views(scene: rrb.Spatial3DView, what: Shown) -> rrb.Blueprint:
    overview = rrb.Vertical(
        rrb.Horizontal(
            _pictures(scene, what),
            *([_maps(what)] if what.has_maps else []),
            _why(what),
            column_shares=[5, 4, 3] if what.has_maps else [6, 3],
        ),
        rrb.Horizontal(*_curves(what), _events(), column_shares=[4, 4, 5]),
        row_shares=[3, 2],
        name="Scene" if what.is_scene else "Object",
    )
    tabs = [overview, *_scene_tabs(what)]
    return rrb.Blueprint(
        rrb.Tabs(*tabs) if len(tabs) > 1 else overview,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=entities.TIMELINE, state="collapsed"),
        auto_views=False,
    )


def _scene_tabs(what: Shown) -> list[rrb.Container]:
    """What only several objects have, a tab of the whole window each."""
    tabs: list[rrb.Container] = []
    if what.is_scene:
        tabs.append(rrb.Grid(*(_objects_curves(b, what) for b in what.branches), name="Objects"))
    if what.has_graph:
        graph = rrb.GraphView(
            origin=entities.GRAPH,
            contents=[f"+ {entities.GRAPH}/**", f"- {entities.EVIDENCE}"],
            name="Which object has to do with which",
            force_link=rrb.archetypes.ForceLink(distance=140),
            force_collision_radius=rrb.archetypes.ForceCollisionRadius(enabled=True),
        )
        evidence = rrb.TextDocumentView(origin=entities.EVIDENCE, name="Evidence and order")
        tabs.append(rrb.Horizontal(graph, evidence, column_shares=[3, 2], name="Dependencies"))
    if what.has_tree:
        tree = rrb.GraphView(
            origin=entities.TREE,
            name="Search tree: hypothesis, visits, mean cost",
            force_link=rrb.archetypes.ForceLink(enabled=False),
            force_many_body=rrb.archetypes.ForceManyBody(enabled=False),
            force_position=rrb.archetypes.ForcePosition(enabled=False),
            force_center=rrb.archetypes.ForceCenter(enabled=False),
        )
        why = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
        tabs.append(
            rrb.Horizontal(tree, rrb.Vertical(_series("cost", what), why), column_shares=[3, 2], name="Search tree")
        )
    return tabs


def _objects_curves(branch: str, what: Shown) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=f"{entities.CURVES}/score/{branch}",
        name=f"{branch}: score of each hypothesis",
        plot_legend=_legend(what),
    )


def _hidden(what: Shown) -> dict[Any, Any]:
    # The mixed pose only starts the refiner, and what is best for the scene has a view of its own.
    stages = [f"{entities.OBJECTS}/{b}/stages/{s}" for b in what.branches for s in ("mixed", "incumbent")]
    return {stage: rrb.EntityBehavior(visible=False) for stage in stages}


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


def _pictures(scene: rrb.Spatial3DView, what: Shown) -> rrb.Container:
    views: list[rrb.View] = [scene]
    if what.is_scene:
        views.append(_answer(what))
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


def _series(name: str, what: Shown) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=f"{entities.CURVES}/{name}", name=CURVE_TITLES[name], plot_legend=_legend(what, name)
    )


def _legend(what: Shown, name: str = "score") -> rrb.PlotLegend:
    per_arm = name in ("score", "ucb", "pulls")
    return rrb.PlotLegend(rrb.Corner2D.RightBottom, visible=what.has_legend or not per_arm)


def _curves(what: Shown) -> list[rrb.Container]:
    left, right = ["score", "ucb", "pulls"], ["physics", "fit"]
    if what.is_scene:
        left = ["best", *left]
    if what.has_passes:
        left = ["scene", *left]
    if what.has_tree:
        left = ["cost", *left]
    if what.has_truth:
        right.insert(0, "error")
    return [rrb.Tabs(*(_series(name, what) for name in names)) for names in (left, right)]


def _events() -> rrb.Container:
    return rrb.Vertical(
        rrb.StateTimelineView(origin=entities.LANE, name="Object, hypothesis, kept stage, event"),
        rrb.TextLogView(origin=entities.LOG, name="Events"),
    )


def _why(what: Shown) -> rrb.Container | rrb.View:
    text = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
    if what.has_tree:
        return text
    bandit = rrb.BarChartView(origin=entities.BANDIT, name="UCB of each hypothesis above the lowest, at the choice")
    return rrb.Vertical(text, bandit, row_shares=[3, 1])
