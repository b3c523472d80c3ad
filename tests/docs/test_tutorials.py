"""The tutorials run, as cells of one namespace each, and what their texts say of the results is true."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import matplotlib
import nbformat
import pytest
from matplotlib import pyplot as plt

from verefine_viz.refiners.registry import REFINERS

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = ROOT / "docs" / "tutorials"
pytestmark = pytest.mark.usefixtures("processes")


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Where tutorials write; a refiner that they register is gone with the test."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    for name in ("nudge", "ShiftNet"):
        monkeypatch.setitem(REFINERS, name, None)
    matplotlib.use("Agg")
    yield
    plt.close("all")


def run(name: str) -> tuple[dict[str, Any], str]:
    """The names that a tutorial leaves, and what it prints."""
    names: dict[str, Any] = {"__name__": name}
    printed = io.StringIO()
    with redirect_stdout(printed):
        for k, cell in enumerate(nbformat.read(TUTORIALS / f"{name}.ipynb", 4).cells):
            if cell.cell_type == "code":
                exec(compile(cell.source, f"{name}, cell {k}", "exec"), names)
    return names, printed.getvalue()


def test_they_are_notebooks_without_outputs() -> None:
    files = sorted(TUTORIALS.glob("*.ipynb"))
    assert len(files) == 7
    for file in files:
        notebook = json.loads(file.read_text(encoding="utf-8"))
        nbformat.validate(notebook)
        assert notebook["cells"][0]["source"][0].startswith("# "), file
        code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
        assert all(not cell["outputs"] and cell["execution_count"] is None for cell in code), file


def test_a_first_failure_is_explained_and_mended() -> None:
    names, printed = run("first_failure")
    assert names["answer"].is_correct is False
    assert names["cause"].cause == "arm_starved"
    assert 5 not in names["played"]
    assert names["mended"].is_correct
    assert names["mended"].best_hypothesis == 5
    assert "Hypothesis 5 of the carton got 0 of 10 iterations" in printed
    assert [len(ax.images) for ax in names["axes"]] == [1, 1]


def test_a_frame_of_ones_own_is_solved_and_kept(tmp_path: Path) -> None:
    names, _ = run("your_own_frame")
    assert "0.001 would fit better" in names["complaint"]
    assert names["answer"].score > 0.9 > names["answer"].initial_score
    assert names["shift_mm"] < 1
    assert names["moved_mm"] < 2
    assert names["folder"].parent == tmp_path
    assert (names["folder"] / "frames" / "session.toml").is_file()


def test_a_refiner_of_ones_own_shifts_and_does_not_turn() -> None:
    names, _ = run("your_own_refiner")
    (score, frame) = names["vv"].score, names["frame"]
    assert (score(frame, "mug", names["nudged"]).score > score(frame, "mug", names["poses"]).score).all()
    nudge, icp = names["answers"]["nudge"], names["answers"]["icp"]
    assert icp.is_correct
    assert not nudge.is_correct
    assert nudge.rotation_deg > 20 > icp.rotation_deg
    assert [stage.name for stage in names["first"].stages] == ["current", "simulated", "mixed", "refined"]
    assert names["by_net"].session.method.refiner == "ShiftNet"
    assert names["by_net"]["mug"].score > names["by_net"]["mug"].initial_score


def test_a_loop_of_ones_own_shows_its_fault() -> None:
    names, printed = run("your_own_loop")
    assert names["worst"] == 5
    assert "the largest fall is in step 5" in printed
    assert names["trace"].n_problems == 0
    assert names["rir"].is_correct
    assert names["rir"].score > names["answer"].score


def test_a_live_loop_decides_by_the_verdict_and_leaves_traces() -> None:
    names, printed = run("live_loop")
    assert len(names["verdicts"]) == 3
    assert any(names["verdicts"])
    assert names["trace"].n_problems == 0
    assert printed.count("verdict after") == 3
    assert names["slow"]["mug"].score > 0.9
    assert sorted(path.name for path in names["folder"].iterdir()) == ["000000", "000001", "000002"]


def test_a_data_set_is_solved_evaluated_and_reported() -> None:
    names, printed = run("data_set_and_report")
    batch = names["batch"]
    assert {(one.name, one.cause) for one in batch.answers} == {("mug", ""), ("bowl", ""), ("bowl", "symmetric")}
    assert {one.name for one in batch.failures} == {"bowl"}
    assert [*batch.runs] == ["1/1", "1/2", "1/3"]
    assert 0.7 < names["recall"].ar < 1
    assert "3 frames" in printed
    assert (names["folder"] / "runs" / "report.html").stat().st_size > 100_000


def test_frames_are_labelled_and_a_wrong_pose_does_not_look_verified() -> None:
    names, printed = run("label_your_own_data")
    mug, better = names["mug"], names["better"]
    assert (mug.light, better.light) == ("green", "green")
    assert names["off_mm"](names["problems"][0], mug) < 2
    assert names["off_mm"](names["problems"][1], better) < 2
    assert names["beside"].light == "red"
    turned = names["turned"]
    assert turned.light == "amber"
    assert turned.score < better.score
    assert turned.undetermined_deg > 45
    assert names["handle_deg"] > 45
    assert [(can.light, can.undetermined_deg) for can in names["cans"]] == [("amber", 180.0)] * 2
    assert "4 labels of 2 frames written" in printed
    assert "No part needs a look" in printed
    assert names["scores"].recalls.ar > 0.8
    (scene,) = (names["data"] / "test").iterdir()
    truth = json.loads((scene / "scene_gt.json").read_text())
    assert [len(of) for of in truth.values()] == [2, 2]
