"""The objects over the frames of a scene, as columns of numbers with their marks: the want ``sequence``.

The source is the open batch, which may be of a watched folder; else what another program recorded; else the frames that
were solved here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from verefine_viz.batch.motion_table import KnownShapes, MotionRow, MotionTrack, motion_rows, tracks_of
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.problem import Target
from verefine_viz.core.records import Best
from verefine_viz.evaluation.pose_motion import FLIP_DEG, JUMP_DEG, JUMP_MM, NEAR_DEG
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import SequenceAnswer, SequenceLane, SequenceMark
from verefine_viz.page.views.pixel_maps import packed
from verefine_viz.run.record import Answer, RunEnd, RunRecord, awaited

if TYPE_CHECKING:
    from verefine_viz.batch.index import BatchIndex
    from verefine_viz.page.blobs import Blobs
    from verefine_viz.page.workspace import Workspace

OF_MOTION = ("moved_mm", "turned_deg")
OF_ROW = ("score", "recorded_score", "undetermined_mm", "missing_depth")
OF_ANSWER = {"err": "add_s_mm", "share": "relative_error", "colour_fit": "colour_fit"}
"""Numbers of an object in a frame: fields of its answer by the names of the arrays."""
STATES = ("nothing", "pose", "no pose", "not solved")
LEGEND = {
    "flip": f"turned by more than {FLIP_DEG:.0f}° to where its shape nearly looks the same "
    f"(within {NEAR_DEG:.0f}°): depth hardly tells the two apart",
    "jump": f"turned by more than {JUMP_DEG:.0f}° or moved by more than {JUMP_MM:.0f} mm from one frame to the next, "
    "and no symmetry of its shape explains it",
    "lost": "had a pose, and has none",
    "recovered": "has a pose again",
}


@dataclass(frozen=True)
class Followed:
    """Objects over frames, and their answers."""

    run: str
    tracks: tuple[MotionTrack, ...]
    answers: Mapping[tuple[str, int | None, int | None], tuple[int, Answer]]
    """By frame, model and instance: key in the gallery, -1 = in none, and the answer."""
    is_sequence: bool
    """Whether the frames follow each other in time, so that changes between them mean motion."""


def sequence(space: Workspace, want: p.SequenceWanted, blobs: Blobs) -> SequenceAnswer:
    """Return the lanes of a scene.

    Raises:
        InputError: there is no such run or scene, or a batch's motion.csv is damaged.
    """
    found = _of_batch(space.runs, want.run or space.batch_run) if space.batch_run or want.run else _here(space)
    scenes = sorted({track.scene_id for track in found.tracks})
    here = parse_frame(space.frame)[0]
    scene = want.scene if want.scene is not None else here if here in scenes or not scenes else scenes[0]
    if want.scene is not None and scene not in scenes:
        raise InputError(unknown("scene", scene, scenes))
    tracks = [track for track in found.tracks if track.scene_id == scene]
    frames = sorted({row.frame for track in tracks for row in track.rows}, key=parse_frame)
    place = {frame: i for i, frame in enumerate(frames)}
    marks = (
        SequenceMark(lane, place[track.rows[mark.place].frame], mark.kind)
        for lane, track in enumerate(tracks)
        for mark in track.marks
    )
    blob, arrays = packed(_columns(found, tracks, place), blobs)
    return SequenceAnswer(
        run=found.run,
        scene=scene,
        scenes=scenes,
        frames=frames,
        lanes=[
            SequenceLane(one.name, one.rows[0].obj_id, one.counts.text if found.is_sequence else "") for one in tracks
        ],
        marks=[*marks] if found.is_sequence else [],
        reference="world" if all(row.reference == "world" for one in tracks for row in one.rows) else "camera",
        legend=LEGEND if found.is_sequence else {},
        jump_mm=JUMP_MM,
        jump_deg=JUMP_DEG,
        blob=blob,
        arrays=arrays,
    )


def _columns(found: Followed, tracks: Sequence[MotionTrack], place: Mapping[str, int]) -> dict[str, NDArray[Any]]:
    """Return arrays (lanes, frames) by name; unknown numbers are NaN, and an array without any number is left out."""
    shape = len(tracks), len(place)
    numbers = {name: np.full(shape, np.nan, np.float32) for name in (*OF_MOTION, *OF_ROW, *OF_ANSWER)}
    states, keys = np.zeros(shape, np.uint8), np.full(shape, -1, np.int32)
    for lane, track in enumerate(tracks):
        for row in track.rows:
            at = lane, place[row.frame]
            states[at] = _state(row)
            for name in (*(OF_MOTION if row.kind not in STATES else ()), *OF_ROW):
                numbers[name][at] = getattr(row, name)  # None is NaN.
            keys[at], answer = found.answers.get((row.frame, row.obj_id, row.instance_id), (-1, None))
            for name, field in OF_ANSWER.items() if answer is not None else ():
                numbers[name][at] = getattr(answer, field)
    shown = {
        name: values
        for name, values in numbers.items()
        if np.isfinite(values).any() and (found.is_sequence or name not in OF_MOTION)
    }
    return {**shown, "state": states, "key": keys}


def _state(row: MotionRow) -> int:
    return STATES.index(row.kind) if row.kind in STATES else STATES.index("pose")


def _of_batch(runs: Mapping[str, BatchIndex], run: str) -> Followed:
    """Return the objects of a batch's frames, which may be in any order."""
    if run not in runs:
        raise InputError(unknown("run", run, runs))
    entries = ((name, row) for name, index in runs.items() for row in index.rows)
    keyed = [(key, row) for key, (name, row) in enumerate(entries) if name == run]
    answers = {(row.frame, row.obj_id, row.instance_id): (key, row) for key, row in keyed}
    tracks = runs[run].tracks
    return Followed(run, tracks or runs[run].unordered_tracks, answers, is_sequence=bool(tracks))


def _here(space: Workspace) -> Followed:
    """Return what another program recorded, with our numbers for the frames that were solved here; without a recording,
    those frames alone.
    """
    solved = {frame: _solved(space, frame, pairs) for frame, pairs in space.solved.items()}
    recorded = _recorded(space, solved)
    if len(recorded) > 1:
        records = recorded
    elif len(solved) > 1:
        records = [solved.get(frame) or awaited(frame) for frame in sorted(space.frames, key=parse_frame)]
    else:
        return Followed("", (), {}, is_sequence=True)
    ends = [record.end for record in records if record.end is not None]
    answers = {(one.frame, one.obj_id, one.instance_id): (-1, one) for end in ends for one in end.answers}
    evaluator = space.work.first.final_evaluator
    shapes = KnownShapes(space.problem.models, evaluator.flips)
    return Followed("", tracks_of(motion_rows(records, shapes)), answers, is_sequence=True)


def _solved(space: Workspace, frame: str, pairs: Sequence[tuple[Target, Best]]) -> RunRecord:
    """Return the answers of a frame that was solved here."""
    evaluator = space.work.first.final_evaluator
    answers = []
    for target, best in pairs:
        instance, model = target.instance, target.model
        T_gt = instance.T_cam_obj_gt
        answers.append(
            Answer(
                frame=frame,
                instance_id=instance.instance_id,
                obj_id=instance.obj_id,
                name=model.name,
                status="ok",
                T_cam_obj=best.T_cam_obj,
                middle_m=model.middle_m,
                score=best.score.score,
                colour_fit=best.score.colour_fit,
                add_s_mm=None if T_gt is None else evaluator.add_s_mm(model, best.T_cam_obj, T_gt),
                diameter_mm=1e3 * model.diameter_m,
            )
        )
    observation = pairs[0][0].observation
    T_table_cam = None if observation.support is None else observation.support.T_world_cam
    record = awaited(frame)
    header = structs.replace(record.header, T_map_cam=observation.T_map_cam, T_table_cam=T_table_cam)
    return structs.replace(record, header=header, end=RunEnd(answers=(*answers,)))


def _recorded(space: Workspace, solved: Mapping[str, RunRecord]) -> list[RunRecord]:
    """Return the frames that another program recorded; its poses, with the numbers of our answers."""
    models, of_frame = space.problem.models, dict[str, list[Answer]]()
    ours = {(one.frame, one.obj_id): one for record in solved.values() if record.end for one in record.end.answers}
    for obj_id, poses in space.recorded_tracks.items():
        model = models.get(obj_id)
        for one in poses:
            own = ours.get((one.frame, obj_id)) or Answer(frame=one.frame, obj_id=obj_id, status="ok")
            recorded = structs.replace(
                own,
                name=f"object {obj_id}" if model is None else model.name,
                instance_id=None,
                T_cam_obj=one.T_cam_obj,
                middle_m=None if model is None else model.middle_m,
                recorded_score=one.score,
            )
            of_frame.setdefault(one.frame, []).append(recorded)
    return [structs.replace(awaited(frame), end=RunEnd(answers=(*rows,))) for frame, rows in of_frame.items()]
