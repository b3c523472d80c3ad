"""The recording over the frames of a sequence: what is in it, and that it is told apart from that of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.fakes import box_model
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.evaluation.pose_motion import Kind
from verefine_viz.recording import rerun_viewer
from verefine_viz.recording.entities import SEQUENCE_FILE
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.recording.sequence_recording import FRAME, SequenceFrame, SequenceTrack, write_sequence


def tracks(n: int = 20, knows_camera: bool = False) -> list[SequenceTrack]:
    """Two boxes; the first flips in frame 7, is lost in frame 9 and recovered in frame 10."""
    both = []
    for k, name in enumerate(("a box", "b/ox")):
        frames = []
        for i in range(n):
            T = None if (k, i) == (0, 9) else transform(np.eye(3), [0.2 * k + 0.005 * i, 0, 0.6])
            kind: Kind = "no pose" if T is None else "flip" if (k, i) == (0, 7) else "moved"
            numbers = {} if T is None else {"moved_mm": 5.0, "turned_deg": 0.5, "score": 0.8 + 0.01 * k}
            T_map_cam = transform(np.eye(3), [-0.005 * i, 0, 0]) if knows_camera else None
            frames.append(SequenceFrame(i, T, T_map_cam, kind, numbers))
        both.append(SequenceTrack(3, name, box_model() if k == 0 else None, tuple(frames)))
    return both


@pytest.mark.parametrize("knows_camera", [True, False])
def test_poses_curves_and_events_are_on_the_timeline_of_frames(knows_camera: bool, tmp_path: Path) -> None:
    path = tmp_path / SEQUENCE_FILE
    write_sequence(path, "Boxes", tracks(knows_camera=knows_camera))
    assert [p.name for p in tmp_path.iterdir()] == [SEQUENCE_FILE]
    rows: dict[str, int] = {}
    for chunk in chunks_of(path):
        if not chunk.is_static:
            assert FRAME in chunk.timeline_names
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    assert rows["/scene_3/objects/0_a_box"] == 20
    assert rows["/scene_3/curves/moved_mm/0_a_box"] == 19
    assert rows["/scene_3/curves/score/1_b_ox"] == 20
    assert rows["/scene_3/events/0_a_box"] == 3
    assert "/scene_3/objects/1_b_ox" not in rows
    assert ("/scene_3/camera" in rows) == knows_camera
    assert not any("recorded_score" in name for name in rows)


def test_it_is_no_recording_of_a_run(tmp_path: Path) -> None:
    write_sequence(tmp_path / SEQUENCE_FILE, "Boxes", tracks())
    with pytest.raises(InputError, match=SEQUENCE_FILE):
        read_recording(tmp_path / SEQUENCE_FILE)


@pytest.mark.usefixtures("processes")
def test_replay_opens_it_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(tmp_path / SEQUENCE_FILE, "Boxes", tracks())
    started: list[list[str]] = []
    monkeypatch.setattr(rerun_viewer, "start_viewer", lambda arguments, env: started.append([*arguments]))
    rerun_viewer.open_viewer(tmp_path / SEQUENCE_FILE, web=False)
    assert started == [[str(tmp_path / SEQUENCE_FILE)]]
