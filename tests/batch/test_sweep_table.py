"""The table after a sweep: what its numbers are, and that the report has the same ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.made_runs import answer
from tests.report.runs import row, write_run
from verefine_viz.batch.batch_command import sweep_row, sweep_table
from verefine_viz.batch.jobs import BatchJob
from verefine_viz.batch.run_batch import BatchOutcome
from verefine_viz.report.bop_recalls import BopRecalls
from verefine_viz.report.group_numbers import compare
from verefine_viz.report.groups import read_runs, sections_of
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import resolve

NO_ANSWER = {"status": "no_answer", "add_s_mm": None, "score": None, "ms_total": 0.0}


def rows_of(seed: int, worse: float) -> list[Answer]:
    """Frames with one to three objects, one of them without an answer, and one frame that failed as a whole."""
    rng = np.random.default_rng(seed)
    known = [
        row(f, i, add_s_mm=round(worse * rng.gamma(1, 6), 3), score=rng.random(), ms_total=round(100 * rng.random(), 3))
        for f in range(1, 6 + seed)
        for i in range(1 + f % 3)
    ]
    return [*known, row(1, 7, **NO_ANSWER), answer(scene_id=1, im_id=99, status="failed", message="no depth")]


def runs(folder: Path) -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for method, worse in (("rir", 1.0), ("pir", 2.0)):
        for seed in range(3):
            settings = {"method": {"name": method, "seed": seed}, "hypotheses": {"seed": seed}}
            run = write_run(folder / f"{method}-{seed}", rows_of(seed, worse), settings)
            found.setdefault(method, []).append(run)
    return found


def test_the_report_has_the_same_numbers(tmp_path: Path) -> None:
    folders = runs(tmp_path)
    read, _ = read_runs([path for mine in folders.values() for path in mine], only_finished=True)
    (section,) = sections_of(read)
    assert len(section.groups) == 2
    for line in compare(section, BopRecalls()).lines:
        mine = sweep_row(run.rows for run in line.group.runs)
        theirs = [line.numbers[name].value for name in ("recall", "median_mm", "score", "ms_per_frame")]
        assert [mine.recall, mine.median_mm, mine.score, mine.ms_per_frame] == pytest.approx(theirs)
        assert mine.n_runs == len(line.group.runs)


def test_objects_of_all_runs_count_the_same() -> None:
    """A run of few objects weighs less: neither medians nor recalls of runs are averaged."""
    few, many = [row(1, add_s_mm=50.0, score=0.1)], [row(k, add_s_mm=float(k), score=0.9) for k in range(1, 10)]
    found = sweep_row([few, many])
    assert (found.recall, found.ends, found.median_mm) == (0.9, (0.0, 1.0), 5.5)
    assert found.score == pytest.approx(0.82)
    assert found.ms_per_frame == 40.0


def test_the_best_comes_first(tmp_path: Path) -> None:
    outcomes = [
        (BatchJob(resolve({}), path, method), BatchOutcome(path, {}, (), 0, 1.0, ""))
        for method, paths in reversed(runs(tmp_path).items())
        for path in paths
    ]
    assert [row[:2] for row in sweep_table(outcomes).rows] == [("rir", "3"), ("pir", "3")]
