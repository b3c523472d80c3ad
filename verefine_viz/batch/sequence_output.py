"""Writes what a batch over a sequence has beside its tables: motion.csv, and sequence.rrd with the answers in 3D."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from verefine_viz.batch.motion_table import (
    MOTION,
    NO_TURNS,
    MotionRow,
    MotionTrack,
    motion_rows,
    read_tracks,
    write_motion,
)
from verefine_viz.batch.runs import Runs
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import VerefineError
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.pose_motion import NO_SYMMETRY
from verefine_viz.recording.entities import SEQUENCE_FILE
from verefine_viz.run.record import RunRecord
from verefine_viz.scenes.source import SceneSource

if TYPE_CHECKING:  # Rerun takes a second to load.
    from verefine_viz.recording.sequence_recording import SequenceFrame


def is_sequence(session: Session, source: SceneSource) -> bool:
    """Whether the frames of a scene are in order, as in a video."""
    scene = session.scene
    return scene.sequence or session.method.track or (scene.source == "folder" and source.is_sequence)


@dataclass
class SequenceOutput:
    """Writes motion.csv and sequence.rrd of a batch."""

    folder: Path
    """The batch folder."""
    source: SceneSource
    """Makes the problems of its frames."""
    _models: dict[int, ObjectModel | None] = field(default_factory=dict)
    _turns: dict[int, Float] = field(default_factory=dict)

    def write_table(self, frames: Sequence[str]) -> None:
        """Write motion.csv of the finished frames.

        Raises:
            InputError: the disk refuses.
        """
        records = Runs(self.folder / "runs").records(sorted(frames, key=parse_frame))
        write_motion(self.folder / MOTION, motion_rows(records, self))

    def write_recording(self, title: str) -> None:
        """Write sequence.rrd from motion.csv and the run files.

        Raises:
            InputError: the disk refuses.
        """
        from verefine_viz.recording.sequence_recording import SequenceTrack, write_sequence

        tracks = read_tracks(self.folder)
        frames = dict.fromkeys(row.frame for track in tracks for row in track.rows)
        records = {record.header.frame: record for record in Runs(self.folder / "runs").records(frames)}
        drawn = [
            SequenceTrack(track.scene_id, track.name, self._model_of(track), self._frames_of(track, records))
            for track in tracks
        ]
        write_sequence(self.folder / SEQUENCE_FILE, title, drawn)

    def _frames_of(self, track: MotionTrack, records: Mapping[str, RunRecord]) -> tuple[SequenceFrame, ...]:
        from verefine_viz.recording.sequence_recording import CURVES, SequenceFrame

        return tuple(
            SequenceFrame(
                row.im_id,
                _answer(row, records.get(row.frame)),
                records[row.frame].header.T_map_cam if row.frame in records else None,
                row.kind,
                {} if row.kind == "no pose" else {name: getattr(row, name) for name in CURVES},
            )
            for row in track.rows
        )

    def _model_of(self, track: MotionTrack) -> ObjectModel | None:
        row = track.rows[0]
        return self._model(row.obj_id, row.frame)

    def symmetries_of(self, obj_id: int, frame: str) -> Float:
        """See :class:`Shapes`; none where the model cannot be read."""
        model = self._model(obj_id, frame)
        return NO_SYMMETRY if model is None else model.symmetries

    def turns_of(self, obj_id: int, frame: str) -> Float:
        """See :class:`Shapes`; none where the model cannot be read."""
        from verefine_viz.evaluation.near_symmetry import flips, near_symmetries

        if obj_id not in self._turns:
            model = self._model(obj_id, frame)
            self._turns[obj_id] = NO_TURNS if model is None else flips(near_symmetries(model))
        return self._turns[obj_id]

    def _model(self, obj_id: int, frame: str) -> ObjectModel | None:
        if obj_id not in self._models:
            with suppress(VerefineError):
                self._models.update(self.source.problem(frame).models)
        return self._models.setdefault(obj_id, None)


def _answer(row: MotionRow, record: RunRecord | None) -> Float | None:
    if row.kind == "no pose" or record is None or record.end is None:
        return None
    own = (a.T_cam_obj for a in record.end.answers if (a.obj_id, a.instance_id) == (row.obj_id, row.instance_id))
    return next(own, None)
