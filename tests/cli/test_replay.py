"""``replay``, one recording to look at, any number to compare with new runs; ``film``, a run told in pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.batch.frames import PoolHere, batch_here, make_frames, write_session
from tests.fakes import box_problem
from tests.recording.runs import ending, new_run, recorded_run, session
from verefine_viz import cli
from verefine_viz.batch import draw_recordings, solve_frame
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS
from verefine_viz.recording import verify
from verefine_viz.recording.reader import read_recording
from verefine_viz.recording.recording_file import chunks_of
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.engine import Run
from verefine_viz.run.record import RunRecord
from verefine_viz.run.run_header import session_of

EXPECTED = {"same.rrd": "30 iterations", "other.rrd": "objects[0]."}


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording, one that was made from other poses, and a file that is none."""
    folder = tmp_path_factory.mktemp("recordings")
    recorded_run(folder / "same.rrd", session(maps=False))
    recorded_run(folder / "other.rrd", session(maps=False), box_problem(3, 2, seed=1))
    (folder / "none.rrd").write_text("rubbish")
    return folder


@pytest.fixture
def folder(recordings: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The recordings; made-up runs are run again."""
    monkeypatch.setattr(verify, "run_again", again)
    monkeypatch.setattr(solve_frame, "end_again", lambda run, recorded: ending(run))
    return recordings


def again(record: RunRecord) -> Run:
    return new_run(session_of(record.header), box_problem(3, 2))


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(
    ("names", "code"),
    [
        (["same.rrd", "same.rrd"], 0),
        (["other.rrd", "same.rrd"], 1),
        (["none.rrd", "other.rrd", "same.rrd"], 2),
    ],
)
def test_several_are_compared_whatever_becomes_of_the_others(
    folder: Path, names: list[str], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["replay", *[str(folder / name) for name in names], "--verify"]) == code
    said = capsys.readouterr()
    compared = [name for name in names if name in EXPECTED]
    for name, line in zip(compared, said.out.splitlines(), strict=True):
        assert line.startswith(f"{folder / name}: ")
        assert EXPECTED[name] in line
    refused = [name for name in names if name not in EXPECTED]
    for name, line in zip(refused, said.err.splitlines(), strict=True):
        assert line.startswith("verefine-viz: ")
        assert name in line


@pytest.mark.usefixtures("processes")
def test_recordings_that_a_batch_has_not_kept_are_drawn_from_its_run_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made = make_frames(tmp_path / "data", 2)
    for name, keep in (("kept", "all"), ("none", "none")):
        settings = write_session(tmp_path, made, recording={"keep": keep})
        assert batch_here(settings, tmp_path / name, "--workers", "1").returncode == 0
    monkeypatch.setattr(draw_recordings, "Pool", PoolHere)
    assert cli.main(["replay", str(tmp_path / "none"), "--draw", "--workers", "1"]) == 0
    for kept in (tmp_path / "kept/recordings").iterdir():
        drawn = tmp_path / "none/recordings" / kept.name
        assert drawn_entities(drawn) == drawn_entities(kept)
        assert first_difference(read_recording(drawn).iterations, read_recording(kept).iterations) is None
    run, out = tmp_path / "none/runs/000007_000001.vfrun", tmp_path / "one.rrd"
    assert cli.main(["replay", str(run), "--draw", "--out", str(out), "--workers", "1"]) == 0
    assert drawn_entities(out)
    run.write_bytes(b"no run")
    out.unlink()
    assert cli.main(["replay", str(run), "--draw", "--out", str(out), "--workers", "1"]) == 1
    assert not out.exists()
    assert str(run) in capsys.readouterr().err


def drawn_entities(path: Path) -> dict[str, int]:
    """How many rows each entity has."""
    rows: dict[str, int] = {}
    for chunk in chunks_of(path):
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    return rows


@pytest.mark.usefixtures("processes")
def test_a_strip_and_an_animation_of_the_same_moments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session = Path(__file__).resolve().parents[2] / "sessions" / "failure_score_prefers_flip.toml"
    png, gif = tmp_path / "run.png", tmp_path / "run.gif"
    for out in (png, gif):
        assert cli.main(["film", str(session), "--out", str(out)]) == 0
    said = capsys.readouterr().out.splitlines()
    n = said.index(next(line for line in said if line.startswith(str(png)))) - 1  # Below the title a line for each.
    assert 4 <= n <= 6
    with Image.open(gif) as film:
        assert getattr(film, "n_frames", 1) == n
    with Image.open(png) as strip:
        colors = {tuple(color) for color in np.asarray(strip.convert("RGB")).reshape(-1, 3).tolist()}
    assert {CLASS_COLORS["explained"], STAGE_COLORS["best"], STAGE_COLORS["ground truth"]} <= colors
