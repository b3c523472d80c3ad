"""What is known of the object in focus over the frames of a sequence: from motion.csv of the batch that is open, else
from what another program recorded; with the scores of the frames that were solved on the page.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from verefine_viz.batch.motion_table import MOTION, MotionRow, Track, read_tracks
from verefine_viz.core.errors import InputError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Target
from verefine_viz.evaluation.near_symmetry import NearSymmetry, flips
from verefine_viz.evaluation.pose_motion import Motion, PosedFrame, motions
from verefine_viz.scenes.recorded_source import RecordedPose, RecordedSource


@dataclass(frozen=True)
class TrackFrame:
    """The object in one frame. None = unknown."""

    motion: Motion
    score: float | None = None
    """Ours, of the answer."""
    recorded_score: float | None = None
    undetermined_mm: float | None = None
    undetermined_deg: float | None = None
    missing_depth: float | None = None
    """Share of the mask without depth."""

    @property
    def frame(self) -> str:
        """``scene/image``."""
        return self.motion.frame


def frame_track(
    batch: Path | None,
    source: object,
    target: Target,
    frame: str,
    near: tuple[NearSymmetry, ...] | None,
    scores: Mapping[str, float],
) -> tuple[TrackFrame, ...]:
    """The frames of the open frame's scene; none where they are no sequence.

    Args:
        batch: folder of the batch whose answers are shown, if any.
        source: of the session's problems.
        target: the object in focus, in the open frame.
        frame: the open frame.
        near: near-symmetries of its model; None while they are unknown: flips then look like jumps.
        scores: ours, of the frames that were solved on the page.
    """
    track = None if batch is None else _of_batch(batch, target, frame)
    if track is not None:
        return tuple(_of_row(row) for row in track.rows)
    recorded = source.tracks.get(target.instance.obj_id, ()) if isinstance(source, RecordedSource) else ()
    if len(recorded) < 2:
        return ()
    changes = _recorded_motions(recorded, target.model, near)
    return tuple(
        TrackFrame(motion, scores.get(motion.frame), one.score) for motion, one in zip(changes, recorded, strict=True)
    )


def _of_row(row: MotionRow) -> TrackFrame:
    return TrackFrame(
        row.motion, row.score, row.recorded_score, row.undetermined_mm, row.undetermined_deg, row.missing_depth
    )


def _of_batch(batch: Path, target: Target, frame: str) -> Track | None:
    """The track that holds the object in the open frame."""
    try:
        changed = (batch / MOTION).stat().st_mtime_ns
        tracks = _tracks(batch, changed)
    except (OSError, InputError):  # The batch has none, or it is being written.
        return None
    instance = target.instance
    for track in tracks:
        for row in track.rows:
            if row.frame == frame and (row.obj_id, row.instance_id) == (instance.obj_id, instance.instance_id):
                return track
    return None


@lru_cache(maxsize=4)
def _tracks(batch: Path, changed: int) -> tuple[Track, ...]:
    return read_tracks(batch)


@lru_cache(maxsize=8)
def _recorded_motions(
    recorded: tuple[RecordedPose, ...], model: ObjectModel, near: tuple[NearSymmetry, ...] | None
) -> tuple[Motion, ...]:
    poses = [PosedFrame(one.frame, one.T_cam_obj) for one in recorded]
    return motions(poses, model.middle_m, flips(near or ()), model.symmetries)
