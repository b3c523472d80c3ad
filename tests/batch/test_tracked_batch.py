"""A batch with ``method.track``: the same for any number of workers, after a kill, on the page, and when replayed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.batch.frames import batch_here
from tests.batch.killed_batches import without_times
from tests.scenes.test_foundation_pose import write_sequence
from tests.scenes.test_trace import picture, pose
from verefine_viz.batch.run_batch import Backend, BatchStatus, run_batch
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.verify import verify
from verefine_viz.run.data_folder import open_session
from verefine_viz.run.run_header import session_of
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox

pytestmark = pytest.mark.usefixtures("processes")

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
def whole(sequence: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("whole") / "out"
    done = batch_here(sequence, out, "--workers", 1, *OPTIONS)
    assert done.returncode == 0, done.stderr
    return out


def test_every_frame_has_an_answer_though_only_the_first_has_a_pose(whole: Path) -> None:
    _, rows = without_times(whole)
    assert [(row["im_id"], row["status"], row["n_hypotheses"]) for row in rows] == [
        (str(k + 1), "ok", "1") for k in range(N)
    ]
    assert (whole / "motion.csv").is_file()


def test_two_workers_and_a_batch_that_goes_on_give_the_same(sequence: Path, whole: Path, tmp_path: Path) -> None:
    assert batch_here(sequence, tmp_path / "two", "--workers", 2, *OPTIONS).returncode == 0
    assert without_times(tmp_path / "two") == without_times(whole)
    # As a kill leaves it, and worse: a frame in the middle is gone, and those after it began with its answer.
    (tmp_path / "two" / "runs" / "000000_000002.vfrun").unlink()
    reports: list[BatchStatus] = []
    session = load_session(tmp_path / "two" / "session.toml")
    outcome = run_batch(session, tmp_path / "two", Backend(1), reports.append, task="explain")
    assert (outcome.n_resumed, outcome.totals["frames_done"]) == (1, N)
    assert reports[0].counts.frames_done <= N
    assert reports[-1].counts.frames_done == N
    assert without_times(tmp_path / "two") == without_times(whole)


def test_the_page_begins_a_frame_as_the_batch_does(sequence: Path, whole: Path) -> None:
    overrides = {"method": {"name": "rir", "track": True, "iterations": 2}, "physics": {"enabled": False}}
    problem = Toolbox(open_session(sequence, overrides)).problem(LAST)  # Without a batch: frames before are solved.
    recorded = read_recording(whole / "recordings" / f"000000_{N:06d}.rrd")
    (pose,) = (pose for pose in session_of(recorded.header).tracked if pose.frame == LAST)
    assert tuple(problem.instances[0].hypotheses[0].T_cam_obj.ravel()) == pose.T_cam_obj
    assert problem.instances[0].hypotheses[0].source == f"tracked, the answer of frame 0/{N - 1}"


def test_a_recording_is_the_same_when_run_again(whole: Path) -> None:
    result = verify(whole / "recordings" / f"000000_{N:06d}.rrd")
    assert (result.difference, result.n_compared) == (None, 2)
