"""Which folders a report accepts."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.report.runs import row, write_run
from verefine_viz import cli
from verefine_viz.core.errors import InputError
from verefine_viz.report.bop_recalls import run_rows
from verefine_viz.report.run_results import load, load_pair

DEMO = {"scene": {"source": "demo", "demo": "mug"}}


def refused(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """The one line with which these words are refused."""
    assert cli.main(["report", *map(str, words)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    return lines[0]


def test_what_is_no_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "is no folder of a batch" in refused(capsys, tmp_path)
    assert "does not exist; expected the folder of a batch run" in refused(capsys, tmp_path / "nowhere")
    assert "has no finished frame yet" in refused(capsys, write_run(tmp_path / "a", []))


def test_runs_that_cannot_be_compared_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a, other_object = write_run(tmp_path / "a", [row(1)], DEMO), write_run(tmp_path / "b", [row(2)], DEMO)
    other_data = write_run(tmp_path / "c", [row(1)], {"scene": {"source": "demo", "demo": "clutter"}})
    assert "only runs on the same data compare" in refused(capsys, a, other_data)
    assert "have no object in common" in refused(capsys, a, other_object)
    assert "are the same folder" in refused(capsys, a, a)
    assert "expected the name of a file" in refused(capsys, a, "--out", tmp_path)
    assert "expected 0 to 10000" in refused(capsys, a, "--failures", "-1")


def test_failures_are_wrong_or_missing_answers_worst_first_or_the_lowest_scores(tmp_path: Path) -> None:
    rows = [row(1), row(2, add_s_mm=30.0), row(3, add_s_mm=50.0), row(4, add_s_mm=None, status="no_answer")]
    run = load(write_run(tmp_path / "a", rows))
    assert [r.im_id for r in run.failures] == [4, 3, 2]
    rows = [row(k, has_truth=False, add_s_mm=None, score=score) for k, score in ((1, 0.9), (2, 0.1), (3, 0.5))]
    run = load(write_run(tmp_path / "a", rows))
    assert [r.im_id for r in run.failures] == [2, 3, 1]


def test_answers_belong_to_their_instances_and_two_runs_are_called_a_and_b(tmp_path: Path) -> None:
    rows = [row(1, 0), row(1, 1, status="no_answer", add_s_mm=None), row(1, 2)]
    run = load(write_run(tmp_path / "a", rows))
    assert sorted(run.index.answers("1/1")) == [0, 2]
    assert run.index.answers("1/99") == {}
    a, b = load_pair(write_run(tmp_path / "a", [row(1)]), write_run(tmp_path / "b", [row(1)]))
    assert (a.label, b.label) == ("A", "B")


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda file: file.write_text("{"), "000001_000001.vfrun is no run file"),
        (lambda file: file.write_bytes(file.read_bytes()[:-1] + b"x"), "bytes in the middle are damaged"),
        (Path.unlink, "says nothing about frame 1/1; the same batch command solves it again"),
    ],
)
def test_answers_whose_run_file_is_lost_are_not_scored_as_missing(
    damage: Callable[[Path], object], why: str, tmp_path: Path
) -> None:
    folder = write_run(tmp_path / "run", [row(0), row(1)])
    damage(folder / "runs" / "000001_000001.vfrun")
    with pytest.raises(InputError) as caught:
        list(run_rows(load(folder), ("1/0", "1/1")))
    assert why in str(caught.value)
