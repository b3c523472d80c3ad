"""A recording over the frames of a sequence: where the answers are, and their curves, on the timeline ``frame``.

A batch writes it beside its tables; each frame's own recording goes over iterations. Poses are in the world where the
data set knows the camera's, and the camera moves; else in the camera's frame.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import apply
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.evaluation.pose_motion import Kind, marks
from verefine_viz.recording.background import DRAWN_FACES, drawn_mesh
from verefine_viz.recording.drawn_poses import NOWHERE
from verefine_viz.recording.recording_file import RecordingFile
from verefine_viz.recording.views import DARK

FRAME = "frame"
"""The timeline: the number of the image."""
CURVES: Mapping[str, str] = {
    "moved_mm": "Moved since the frame before [mm]",
    "turned_deg": "Turned since the frame before [°]",
    "score": "Score of the answer",
    "recorded_score": "Recorded score of the answer",
    "missing_depth": "Share of the mask without depth",
    "undetermined_mm": "Undetermined shift [mm]",
}
"""What is drawn of a frame's numbers, with titles."""
MOST_SCENES = 8
"""Scenes that get a tab; all are in the file."""


@dataclass(frozen=True, eq=False)
class SequenceFrame:
    """One object in one frame."""

    im_id: int
    T_cam_obj: Float | None
    """(4, 4) the answer [m]; None where it has none."""
    T_map_cam: Float | None
    """(4, 4) camera to the data set's world [m]; None = unknown."""
    kind: Kind
    numbers: Mapping[str, float | None]
    """By the names in :data:`CURVES`; None = unknown."""


@dataclass(frozen=True, eq=False)
class SequenceTrack:
    """One object over the frames of a scene."""

    scene_id: int
    name: str
    model: ObjectModel | None
    """None: it cannot be read, and only the curves are drawn."""
    frames: tuple[SequenceFrame, ...]


def write_sequence(path: Path, title: str, tracks: Sequence[SequenceTrack]) -> None:
    """Writes the recording; it appears under its name only when it is whole.

    Raises:
        InputError: the disk refuses.
    """
    part = path.with_name(path.name + ".part")
    file = RecordingFile(part)
    file.send_properties({"title": title, "of": "sequence"}, f"{title} sequence".strip())
    scenes: dict[int, list[SequenceTrack]] = {}
    for track in tracks:
        scenes.setdefault(track.scene_id, []).append(track)
    for scene_id, of_scene in scenes.items():
        _log_scene(file, f"/scene_{scene_id}", of_scene)
    file.send_blueprint(_blueprint(scenes))
    file.close()
    try:
        part.replace(path)
    except OSError as error:
        raise InputError(f"cannot write the recording {path}: {error.strerror}") from None


def _log_scene(file: RecordingFile, root: str, tracks: Sequence[SequenceTrack]) -> None:
    frames = {one.im_id: one for track in tracks for one in track.frames}
    is_in_world = all(one.T_map_cam is not None for one in frames.values())
    file.log(root, rr.ViewCoordinates.RIGHT_HAND_Z_UP if is_in_world else rr.ViewCoordinates.RDF)
    if is_in_world:
        cameras = [one.T_map_cam for _, one in sorted(frames.items()) if one.T_map_cam is not None]
        _send_transforms(file, f"{root}/camera", sorted(frames), np.array(cameras))
        file.log(f"{root}/camera", rr.TransformAxes3D(0.1))
    for k, track in enumerate(tracks):
        name = f"{k}_{re.sub(r'[^A-Za-z0-9_-]+', '_', track.name).strip('_')[:40] or 'object'}"
        color = OBJECT_COLORS[k % len(OBJECT_COLORS)]
        _log_poses(file, f"{root}/objects/{name}", f"{root}/paths/{name}", track, color, is_in_world)
        for curve in CURVES:
            _log_curve(file, f"{root}/curves/{curve}/{name}", track, curve, color)
        for mark in marks([one.kind for one in track.frames]):
            words = rr.TextLog.columns(text=[f"{track.name}: {mark.kind}"], level=["WARN"], color=[color])
            file.send(f"{root}/events/{name}", [track.frames[mark.place].im_id], words, timeline=FRAME)


def _log_poses(
    file: RecordingFile, entity: str, path: str, track: SequenceTrack, color: RGB, is_in_world: bool
) -> None:
    """The answers' meshes, and the path of the object's middle."""
    if track.model is None:
        return
    poses = [_pose(one, is_in_world) for one in track.frames]
    file.log(entity, drawn_mesh(track.model, DRAWN_FACES, color, 255))
    _send_transforms(file, entity, [one.im_id for one in track.frames], np.array(poses))
    middles = [apply(T, track.model.middle_m[None])[0] for T in poses if T is not NOWHERE]
    if len(middles) > 1:
        file.log(path, rr.LineStrips3D([np.array(middles)], colors=[(*color, 160)], radii=[-1.0]))


def _pose(one: SequenceFrame, is_in_world: bool) -> Float:
    if one.T_cam_obj is None:
        return NOWHERE
    return one.T_map_cam @ one.T_cam_obj if is_in_world and one.T_map_cam is not None else one.T_cam_obj


def _send_transforms(file: RecordingFile, entity: str, frames: Sequence[int], poses: Float) -> None:
    columns = rr.Transform3D.columns(translation=poses[:, :3, 3], mat3x3=poses[:, :3, :3])
    file.send(entity, frames, columns, timeline=FRAME)


def _log_curve(file: RecordingFile, entity: str, track: SequenceTrack, curve: str, color: RGB) -> None:
    known = [(one.im_id, value) for one in track.frames if (value := one.numbers.get(curve)) is not None]
    if known:
        frames, values = zip(*known, strict=True)
        file.log(entity, rr.SeriesLines(names=[track.name], colors=[color], widths=[1.5]))
        file.send(entity, frames, rr.Scalars.columns(scalars=values), timeline=FRAME)


def _blueprint(scenes: Mapping[int, Sequence[SequenceTrack]]) -> rrb.Blueprint:
    tabs = [_scene_view(f"/scene_{scene_id}", scene_id, scenes[scene_id]) for scene_id in [*scenes][:MOST_SCENES]]
    return rrb.Blueprint(
        rrb.Tabs(*tabs) if len(tabs) != 1 else tabs[0],
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(timeline=FRAME, state="collapsed", play_state="paused"),
        auto_views=False,
    )


def _scene_view(root: str, scene_id: int, tracks: Sequence[SequenceTrack]) -> rrb.Container:
    known = {name for track in tracks for one in track.frames for name, v in one.numbers.items() if v is not None}
    curves = [
        rrb.TimeSeriesView(
            origin=f"{root}/curves/{name}",
            name=title,
            plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop, visible=len(tracks) > 1),
        )
        for name, title in CURVES.items()
        if name in known
    ]
    contents = [f"+ {root}/objects/**", f"+ {root}/paths/**", f"+ {root}/camera"]
    scene = rrb.Spatial3DView(origin=root, contents=contents, name="Answers", background=DARK)
    events = rrb.TextLogView(origin=f"{root}/events", name="Flips, jumps, lost and recovered")
    return rrb.Horizontal(
        rrb.Vertical(scene, events, row_shares=[3, 1]), rrb.Vertical(*curves), name=f"Scene {scene_id}"
    )
