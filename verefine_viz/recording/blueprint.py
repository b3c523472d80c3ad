"""How a recording looks when it is opened: what a person needs first is largest."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.core.errors import InputError
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.maps import OBSERVED
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.rrd_messages import Store, messages

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
WITHOUT_CHOICE = ("refine", "phys_before", "phys_after", "pir", "sir", "physim_mcts")
"""Methods whose iterations do not say how a bandit chose the hypothesis."""
LEGEND_ARMS = 12
"""With more hypotheses a legend would hide the curves."""


@dataclass(frozen=True)
class Shown:
    """What there is to be shown; recordings that agree in it share their views."""

    branches: tuple[str, ...]
    worked_on: tuple[str, ...]
    """Of them, those that have hypotheses."""
    has_truth: bool
    has_maps: bool
    has_graph: bool
    has_passes: bool
    has_tree: bool
    has_choice: bool
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
        worked_on=tuple(b.name for b in branches if b.n_arms),
        has_truth=any(b.has_truth for b in branches),
        has_maps=has_maps,
        has_graph=layout.has_graph and layout.is_scene,
        has_passes=layout.has_passes,
        has_tree=layout.has_tree,
        has_choice=layout.method not in WITHOUT_CHOICE,
        has_legend=all(b.n_arms <= LEGEND_ARMS for b in branches),
    )


def blueprint_of(layout: Layout, has_maps: bool) -> rrb.Blueprint:
    """The blueprint of a recording."""
    what = shown(layout, has_maps)
    spatial = _spatial(what)
    return _WithEye(_all_views(spatial, what), spatial, layout)


def blueprint_messages(layout: Layout, has_maps: bool) -> bytes:
    """The same as messages for ``RrdFile.close``."""
    return _prepared(shown(layout, has_maps)).messages(layout)


class _WithEye(rrb.Blueprint):
    def __init__(self, views: rrb.Blueprint, spatial: Sequence[rrb.Spatial3DView], layout: Layout) -> None:
        super().__init__()
        self._views, self._spatial, self._layout = views, spatial, layout

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._views._log_to_stream(stream)
        stream.send_chunks([chunk for eye in _eyes(self._spatial, self._layout) for chunk in eye.chunks])


class _Prepared(rrb.Blueprint):
    """Views as rerun's messages, made once; only the eye differs from frame to frame."""

    def __init__(self, what: Shown) -> None:
        super().__init__()
        self._spatial = _spatial(what)
        self._what = what
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "views.rbl"
            _make_sure_of_room(path)
            self.save(entities.APPLICATION, path)
            self._views = messages(path.read_bytes())

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        _all_views(self._spatial, self._what)._log_to_stream(stream)
        self._store = Store(stream.get_recording_id() or "", is_blueprint=True)

    def messages(self, layout: Layout) -> bytes:
        # The views come first: they introduce the blueprint that the eyes belong to.
        return self._views + self._store.messages(eye.body for eye in _eyes(self._spatial, layout))


ROOM_BYTES = 1 << 20
"""More than any views take."""


def _make_sure_of_room(path: Path) -> None:
    """A disk that is full would keep rerun waiting for ever.

    Raises:
        InputError: it is.
    """
    try:
        path.write_bytes(bytes(ROOM_BYTES))
    except OSError as error:
        raise InputError(f"cannot write temporary files to {path.parents[1]}: {error.strerror}") from None
    path.unlink()


_prepared = lru_cache(maxsize=32)(_Prepared)


def _eyes(spatial: Sequence[rrb.Spatial3DView], layout: Layout) -> Iterator[Piece]:
    """All 3D views begin at the same place."""
    places = (layout.eye_world, layout.center_world, (0.0, 0.0, 1.0))
    parts = [columns.vectors(of, [place], 3) for of, place in zip(_eye_descriptors(), places, strict=True)]
    for view in spatial:
        yield chunks.rows_of(f"/{view.blueprint_path()}/EyeControls3D", [0], parts, timeline="blueprint")


@cache
def _eye_descriptors() -> tuple[rr.ComponentDescriptor, ...]:
    """Where it is, what it looks at, what is up."""
    batches = rrb.EyeControls3D(position=(0, 0, 0), look_target=(0, 0, 0), eye_up=(0, 0, 0)).as_component_batches()
    found = {b.component_descriptor().component: b.component_descriptor() for b in batches}
    return tuple(found[f"EyeControls3D:{name}"] for name in ("position", "look_target", "eye_up"))


def _all_views(spatial: Sequence[rrb.Spatial3DView], what: Shown) -> rrb.Blueprint:
    curves = _curves(what)
    overview = rrb.Vertical(
        rrb.Horizontal(
            _pictures(spatial, what),
            *([_maps(what)] if what.has_maps else []),
            _why(what),
            column_shares=[5, 4, 3] if what.has_maps else [6, 3],
        ),
        rrb.Horizontal(*curves, _events(), column_shares=[*([8 / len(curves)] * len(curves)), 5]),
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
        tabs.append(rrb.Tabs(*_objects_curves(what), name="Objects"))
    if what.has_graph:
        graph = _graph(f"{entities.GRAPH}/objects", "Which object has to do with which")
        evidence = rrb.TextDocumentView(origin=entities.EVIDENCE, name="Evidence and order")
        tabs.append(rrb.Horizontal(graph, evidence, column_shares=[3, 2], name="Dependencies"))
    if what.has_tree:
        tree = _graph(entities.TREE, "Search tree: hypothesis, visits, mean cost; white: this iteration")
        why = rrb.TextDocumentView(origin=entities.CHOICE, name="This iteration")
        tabs.append(
            rrb.Horizontal(tree, rrb.Vertical(_series("cost", what), why), column_shares=[3, 2], name="Search tree")
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


def _objects_curves(what: Shown) -> Iterator[rrb.Grid]:
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


def _hidden(what: Shown) -> dict[Any, Any]:
    # The mixed pose only starts the refiner, and what is best for the scene has a view of its own.
    stages = [f"{entities.OBJECTS}/{b}/stages/{s}" for b in what.branches for s in ("mixed", "incumbent")]
    return {stage: rrb.EntityBehavior(visible=False) for stage in stages}


def _spatial(what: Shown) -> list[rrb.Spatial3DView]:
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


def _series(name: str, what: Shown) -> rrb.View:
    return rrb.TimeSeriesView(
        origin=f"{entities.CURVES}/{name}", name=CURVE_TITLES[name], plot_legend=_legend(what, name)
    )


def _legend(what: Shown, name: str = "score") -> rrb.PlotLegend:
    per_arm = name in ("score", "ucb", "pulls")
    # Where the curves of a good run are not at its end: scores rise, errors fall.
    corner = rrb.Corner2D.RightTop if name in ("error", "add_s", "physics", "cost") else rrb.Corner2D.RightBottom
    return rrb.PlotLegend(corner, visible=what.has_legend or not per_arm)


def _curves(what: Shown) -> list[rrb.Container]:
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
    return [rrb.Tabs(*(_series(name, what) for name in names)) for names in groups]


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
