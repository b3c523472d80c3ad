"""How a recording looks when it is opened: what a person needs first is largest."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

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
    names = tuple(b.name for b in layout.branches)
    return _Prepared(layout, *_template(names, any(b.has_truth for b in layout.branches), has_maps))


class _Prepared(rrb.Blueprint):
    """The same views for all frames that show the same objects; only the eye differs."""

    def __init__(self, layout: Layout, chunks: tuple[Chunk, ...], scene_view: str) -> None:
        super().__init__()
        self._chunks = chunks
        self._scene_view = scene_view
        self._eye = rrb.EyeControls3D(
            position=layout.eye_world, look_target=layout.center_world, eye_up=(0.0, 0.0, 1.0)
        )

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        stream.send_chunks(self._chunks)
        stream.log(f"{self._scene_view}/EyeControls3D", self._eye)


@lru_cache(maxsize=64)
def _template(branch_names: tuple[str, ...], has_truth: bool, has_maps: bool) -> tuple[tuple[Chunk, ...], str]:
    """The blueprint without its eye, and the path of the 3D view in it."""
    scene = _scene(branch_names)
    blueprint = _all_views(scene, branch_names, has_truth, has_maps)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "views.rbl"
        blueprint.save(entities.APPLICATION, path)
        reader = RrdReader(path)
        (entry,) = reader.blueprints()
        chunks = tuple(reader.stream(store=entry))
    return chunks, scene.blueprint_path()


def _all_views(
    scene: rrb.Spatial3DView, branch_names: tuple[str, ...], has_truth: bool, has_maps: bool
) -> rrb.Blueprint:
    top: list[rrb.Container | rrb.View] = [_pictures(scene, branch_names)]
    if has_maps:
        top.append(_maps())
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(*top, _why(), column_shares=[5, 4, 3] if has_maps else [6, 3]),
            rrb.Horizontal(*_curves(has_truth), _events(), column_shares=[4, 4, 5]),
            row_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=entities.TIMELINE, state="collapsed"),
        auto_views=False,
    )


def _hidden(branch_names: tuple[str, ...]) -> dict[Any, Any]:
    # The mixed pose only starts the refiner; it would hide the others.
    return {f"{entities.OBJECTS}/{b}/stages/mixed": rrb.EntityBehavior(visible=False) for b in branch_names}


def _scene(branch_names: tuple[str, ...]) -> rrb.Spatial3DView:
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
        overrides=_hidden(branch_names),
    )


def _pictures(scene: rrb.Spatial3DView, branch_names: tuple[str, ...]) -> rrb.Container:
    camera = rrb.Spatial2DView(
        origin=entities.CAMERA,
        contents=[f"+ {entities.CAMERA}/**", f"- {entities.DEPTH}", f"+ {entities.OBJECTS}/**"],
        name="Camera",
        overrides=_hidden(branch_names),
    )
    depth = rrb.Spatial2DView(origin=entities.DEPTH, name="Depth")
    return rrb.Tabs(scene, camera, depth)


def _maps() -> rrb.Container:
    views = [rrb.Spatial2DView(origin=f"{entities.MAPS}/{name}", name=title) for name, title in MAP_TITLES.items()]
    return rrb.Tabs(rrb.Grid(*views[:6], grid_columns=2, name="Maps: simulated | refined"), *views[6:])


def _curves(has_truth: bool) -> list[rrb.Container]:
    views = {
        name: rrb.TimeSeriesView(
            origin=f"{entities.CURVES}/{name}", name=title, plot_legend=rrb.PlotLegend(rrb.Corner2D.RightBottom)
        )
        for name, title in CURVE_TITLES.items()
    }
    left = [views["score"], views["ucb"], views["pulls"]]
    right = [views["physics"], views["fit"]]
    if has_truth:
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
