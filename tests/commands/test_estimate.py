"""``verefine-viz estimate``: what it writes is what the estimator found; what fails is said and costs nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.batch.frames import damaged, make_frames, write_session
from verefine_viz import cli
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox
from verefine_viz.scenes.results_csv import read_results

pytestmark = pytest.mark.usefixtures("processes")

BY_PPF = ("--hypotheses.source", "ppf", "--ppf.step", "0.08")
ALONE = ("--workers", "1")
"""Each worker takes seconds to start."""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Workers inherit it.
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def run(*words: object) -> int:
    return cli.main(["estimate", *(str(word) for word in words)])


def test_the_file_holds_what_the_session_s_problem_holds_and_nothing_is_made_that_only_physics_needs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    session, out = write_session(tmp_path, make_frames(tmp_path / "data", 2)), tmp_path / "new" / "ppf_boxes-test.csv"
    words = ("--physics.enabled", "True", "--dependency.order-file", "none.json", "--scene.frames", "7/1")
    assert run(session, "--out", out, *BY_PPF, *words) == 0
    assert "1 frames, 3 objects" in capsys.readouterr().out
    made = {p.name for p in (tmp_path / "cache" / "verefine-viz").iterdir()}
    assert made - {"compiling.lock"} == {"ppf"}  # The lock is there where kernels are compiled first.
    overrides = {"hypotheses": {"source": "ppf"}, "ppf": {"step": 0.08}, "physics": {"enabled": False}}
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "another cache"))  # Its tables are made once more.
    problem = Toolbox(load_session(session, overrides)).problem("7/1")
    wanted = [(i.obj_id, h) for i in problem.instances for h in i.hypotheses]
    rows = read_results(out)
    assert len(rows) == len(wanted) == 6
    for row, (obj_id, h) in zip(rows, wanted, strict=True):
        assert (row.scene_id, row.im_id, row.obj_id, row.score) == (7, 1, obj_id, h.confidence)
        assert np.allclose(row.T_cam_obj, h.T_cam_obj, atol=1e-9)
    assert list(out.parent.iterdir()) == [out]


def test_a_frame_that_fails_is_named_and_the_others_are_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make_frames(tmp_path / "data", 3)
    session = write_session(tmp_path, made)
    (made.scene / "depth" / "000001.png").unlink()
    out = tmp_path / "pool.csv"
    assert run(session, "--out", out, *BY_PPF) == 1
    (failure,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("frame ")]
    assert "/1 failed" in failure
    assert {row.im_id for row in read_results(out)} == {0, 2}
    # Mended and tried again: the frames that are done stay as they are.
    (made.scene / "depth" / "000001.png").write_bytes((made.scene / "depth" / "000000.png").read_bytes())
    before = {row.im_id: row.time_s for row in read_results(out)}
    assert run(session, "--out", out, *BY_PPF, *ALONE, "--retry-failed") == 0
    after = {row.im_id: row.time_s for row in read_results(out)}
    assert after.keys() == {0, 1, 2}
    assert {im_id: after[im_id] for im_id in (0, 2)} == before
    assert not out.with_name("pool.csv.journal").exists()


def test_an_object_whose_model_is_damaged_is_named_and_tried_again_when_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make_frames(tmp_path / "data", 2)
    session, out, file = write_session(tmp_path, made), tmp_path / "pool.csv", made.root / "models" / "obj_000005.ply"
    with damaged(file):
        assert run(session, "--out", out, *BY_PPF, *ALONE) == 1
    said = capsys.readouterr().out.splitlines()
    assert "frame 7/0" in said[1]
    assert str(file) in said[1]
    assert {row.obj_id for row in read_results(out)} == {2}
    assert run(session, "--out", out, *BY_PPF, *ALONE, "--retry-failed") == 0
    assert {row.obj_id for row in read_results(out)} == {2, 5}
    assert not out.with_name("pool.csv.journal").exists()


def test_nothing_found_leaves_an_older_file_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = make_frames(tmp_path / "data", 1)
    session = write_session(tmp_path, made)
    (made.scene / "depth" / "000000.png").unlink()
    out = tmp_path / "pool.csv"
    out.write_text("older")
    assert run(session, "--out", out, *BY_PPF, *ALONE) == 1
    assert "was not written" in capsys.readouterr().out
    assert out.read_text() == "older"
