"""Sequences: tracks of objects over the frames of a scene, motion.csv, and ``method.track``, whose frames wait."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.batch.frames import batch_here
from tests.batch.killed_batches import without_times
from tests.made_runs import answer, finished
from tests.report.pages import section
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_trace import picture, pose, write_box, write_trace
from verefine_viz import cli
from verefine_viz.batch.index import read_batch
from verefine_viz.batch.motion_table import MOTION, NO_TURNS, MotionRow, motion_rows, read_tracks, write_motion
from verefine_viz.batch.run_batch import Backend, BatchStatus, run_batch
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.settings import Session
from verefine_viz.evaluation.pose_motion import NO_SYMMETRY
from verefine_viz.recording.entities import SEQUENCE_FILE
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.verify import verify
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_header import failed_run, session_of
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox

HALF_TURN = transform(axis_angle(np.array([0.0, 0, 1]), np.pi), np.zeros(3))


def result(im_id: int, poses: dict[tuple[int, int], Float | None], scene_id: int = 0) -> RunRecord:
    """A frame with these answers, by (obj_id, instance_id); None: the object has none."""
    rows = [
        answer(
            scene_id, im_id, instance_id=instance, obj_id=obj, name=f"object {obj}", score=0.5, T_cam_obj=T,
            status="no_answer" if T is None else "ok",
        )
        for (obj, instance), T in poses.items()
    ]  # fmt: skip
    return finished(f"{scene_id}/{im_id}", rows)


def at(x_mm: float) -> Float:
    return transform(np.eye(3), np.array([x_mm * 1e-3, 0, 0.6]))


@dataclass
class Shape:
    """The same shape of all objects."""

    turns: Float = field(default_factory=lambda: NO_TURNS)
    symmetries: Float = field(default_factory=lambda: NO_SYMMETRY)
    asked: list[tuple[int, str]] = field(default_factory=list)

    def symmetries_of(self, obj_id: int, frame: str) -> Float:
        return self.symmetries

    def turns_of(self, obj_id: int, frame: str) -> Float:
        self.asked.append((obj_id, frame))
        return self.turns


def rows_of(*results: RunRecord) -> list[MotionRow]:
    return [*motion_rows(results, Shape())]


def test_an_object_is_followed_by_its_model_and_several_of_one_by_their_numbers() -> None:
    rows = rows_of(result(1, {(5, 0): at(0)}), result(2, {(7, 0): at(9), (5, 1): at(3)}), result(3, {(5, 0): at(5)}))
    assert [(r.frame, r.track, r.kind) for r in rows] == [
        ("0/1", "5", "moved"), ("0/2", "5", "moved"), ("0/2", "7", "moved"), ("0/3", "5", "moved"),
        ("0/3", "7", "no pose"),
    ]  # fmt: skip
    assert [r.moved_mm for r in rows if r.track == "5"] == pytest.approx([0, 3, 2])
    rows = rows_of(result(1, {(5, 0): at(0), (5, 1): at(100)}), result(2, {(5, 1): at(101), (5, 0): at(2)}))
    assert {r.track: r.moved_mm for r in rows[2:]} == pytest.approx({"5#0": 2, "5#1": 1})


def test_each_scene_begins_again_and_a_frame_that_failed_has_no_pose() -> None:
    first = [result(1, {(5, 0): at(0)}), failed_run(Session(), {}, "0/2", "no depth"), result(3, {(5, 0): at(4)})]
    rows = rows_of(*first, result(1, {(5, 0): at(500)}, scene_id=2))
    assert [(r.frame, r.kind, r.moved_mm) for r in rows] == [
        ("0/1", "moved", 0), ("0/2", "no pose", 0), ("0/3", "moved", pytest.approx(4)), ("2/1", "moved", 0),
    ]  # fmt: skip


def test_turns_are_asked_for_only_where_something_turns_much(tmp_path: Path) -> None:
    shape = Shape(HALF_TURN[None])
    still = [result(k, {(5, 0): at(k), (6, 1): at(k)}) for k in range(3)]
    assert {row.kind for row in motion_rows(still, shape)} == {"moved"}
    assert shape.asked == []
    turned = [*still, result(3, {(5, 0): at(3) @ HALF_TURN, (6, 1): at(3)})]
    write_motion(tmp_path / MOTION, motion_rows(turned, shape))
    assert shape.asked == [(5, "0/0")]
    five, six = read_tracks(tmp_path)
    assert five.marked("flip") == ("0/3",)
    assert (five.counts.flips, five.counts.flips_per_100, six.counts.flips) == (1, 25, 0)
    symmetric = Shape(symmetries=np.concatenate([NO_SYMMETRY, HALF_TURN[None]]))
    assert {row.kind for row in motion_rows(turned, symmetric)} == {"moved"}
    assert symmetric.asked == []


def test_a_table_that_was_changed_is_refused_in_one_line(tmp_path: Path) -> None:
    for old, new in (("moved", "fell"), ("track", "path"), ("0.5", "half")):
        write_motion(tmp_path / MOTION, rows_of(result(1, {(5, 0): at(0)})))
        (tmp_path / MOTION).write_text((tmp_path / MOTION).read_text().replace(old, new))
        with pytest.raises(InputError, match=r"motion\.csv: "):
            read_tracks(tmp_path)


@pytest.mark.usefixtures("processes")
def test_a_batch_of_a_sequence_writes_its_motion_and_again_where_it_is_gone(tmp_path: Path) -> None:
    folder, out = write_sequence(tmp_path / "box", n=3), tmp_path / "out"
    third = folder / "ob_in_cam" / "1581120424100262102.txt"
    np.savetxt(third, pose(90, 0.004))  # A box turned by 90° looks the same.
    done = batch_here(folder, out, "--workers", 1)
    assert done.returncode == 0, done.stderr
    for number in ("box in scene 0: 3 frames", "1 flip", "33.3 per 100", "0 jumps", "Flips in 0/3."):
        assert number in done.stdout
    (track,) = read_tracks(out)
    assert [row.kind for row in track.rows] == ["moved", "moved", "flip"]
    assert track.rows[1].moved_mm == pytest.approx(2, abs=1e-3)
    table = (out / MOTION).read_bytes()
    (out / MOTION).unlink()
    again = batch_here(folder, out, "--workers", 1)
    assert "nothing was left to do" not in again.stdout
    assert (out / MOTION).read_bytes() == table
    assert "nothing was left to do" in batch_here(folder, out, "--workers", 1).stdout
    assert (out / SEQUENCE_FILE).is_file()
    assert cli.main(["report", str(out)]) == 0
    (motion,) = section(out / "report.html")["tracks"]
    assert (motion["flips"], motion["per_100"], motion["jumps"]) == (1, 33.33, 0)
    assert [kind for *_, kind in motion["moved"]] == ["moved", "moved", "flip"]


@pytest.mark.usefixtures("processes")
def test_the_recorded_score_of_the_answer_is_a_column(tmp_path: Path) -> None:
    write_box(tmp_path / "box.obj")
    for k in (1, 2):
        write_trace(tmp_path / "runs" / f"{k:06d}", tmp_path / "box.obj")
    out = tmp_path / "out"
    assert batch_here(tmp_path / "runs", out, "--workers", 1).returncode == 0
    assert [(row.recorded_score, row.missing_depth) for row in read_batch(out).rows] == [(0.9, 0), (0.9, 0)]
    # Traces that are named by numbers alone are a sequence.
    (track,) = read_tracks(out)
    assert [row.recorded_score for row in track.rows] == [0.9, 0.9]
    assert batch_here(tmp_path / "runs", tmp_path / "rir", "--workers", 1, "--method.name", "rir").returncode == 0
    assert [row.recorded_score for row in read_batch(tmp_path / "rir").rows] == [None, None]


# With method.track

N = 4
OPTIONS = (
    "--method.name", "rir", "--method.track", "True", "--method.iterations", "2", "--physics.enabled", "False",
    "--recording.maps", "False",
)  # fmt: skip
LAST = f"0/{N}"


@pytest.fixture(scope="module")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A box that moves by a millimetre a frame; only the first frame has a pose, all have a mask."""
    folder = write_sequence(tmp_path_factory.mktemp("data") / "box", N)
    _, mask = picture()
    for k, file in enumerate(sorted((folder / "ob_in_cam").iterdir())):
        Image.fromarray(mask.astype(np.uint8) * 255).save(folder / "masks" / f"{file.stem}.png")
        if k:
            file.unlink()
        else:
            np.savetxt(file, pose(3, 0.004))
    return folder


@pytest.fixture(scope="module")
def tracked(sequence: Path, tmp_path_factory: pytest.TempPathFactory, processes: None) -> Path:
    """A batch by one worker; every frame has an answer though only the first has a pose."""
    out = tmp_path_factory.mktemp("tracked") / "out"
    done = batch_here(sequence, out, "--workers", 1, *OPTIONS)
    assert done.returncode == 0, done.stderr
    _, rows = without_times(out)
    assert [(row["im_id"], row["status"], row["n_hypotheses"]) for row in rows] == [
        (str(k + 1), "ok", "1") for k in range(N)
    ]
    assert (out / MOTION).is_file()
    return out


def test_two_workers_and_a_batch_that_goes_on_give_the_same(sequence: Path, tracked: Path, tmp_path: Path) -> None:
    assert batch_here(sequence, tmp_path / "two", "--workers", 2, *OPTIONS).returncode == 0
    assert without_times(tmp_path / "two") == without_times(tracked)
    # As a kill leaves it, and worse: a frame in the middle is gone, and those after it began with its answer.
    (tmp_path / "two" / "runs" / "000000_000002.vfrun").unlink()
    reports: list[BatchStatus] = []
    session = load_session(tmp_path / "two" / "session.toml")
    outcome = run_batch(session, tmp_path / "two", Backend(1), reports.append, task="explain")
    assert (outcome.n_resumed, outcome.totals["frames_done"]) == (1, N)
    assert reports[0].counts.frames_done <= N
    assert reports[-1].counts.frames_done == N
    assert without_times(tmp_path / "two") == without_times(tracked)


def test_the_page_begins_a_frame_as_the_batch_does_and_its_recording_is_verified(sequence: Path, tracked: Path) -> None:
    overrides = {"method": {"name": "rir", "track": True, "iterations": 2}, "physics": {"enabled": False}}
    problem = Toolbox(open_session(sequence, overrides)).problem(LAST)  # Without a batch: frames before are solved.
    recording = tracked / "recordings" / f"000000_{N:06d}.rrd"
    (pose,) = (pose for pose in session_of(read_recording(recording).header).tracked if pose.frame == LAST)
    (hypothesis,) = problem.instances[0].hypotheses
    assert tuple(hypothesis.T_cam_obj.ravel()) == pose.T_cam_obj
    assert hypothesis.source.endswith(f"0/{N - 1}")
    verified = verify(recording)
    assert (verified.difference, verified.n_compared) == (None, 2)
