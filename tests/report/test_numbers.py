"""Headline numbers and differences."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.changing import replace
from tests.made_runs import answer, written
from tests.report.runs import row, write_run
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo, Runs
from verefine_viz.evaluation.pose_table import read_pose_table
from verefine_viz.report.bop_recalls import run_rows
from verefine_viz.report.charts import time_figure
from verefine_viz.report.run_difference import difference
from verefine_viz.report.run_results import (
    THRESHOLDS,
    LoadedRun,
    by_object,
    load,
    load_pair,
    numbers_of,
    recall_curve,
    stage_times,
)
from verefine_viz.report.run_sentences import headline
from verefine_viz.run.record import Answer
from verefine_viz.run.session_file import resolve
from verefine_viz.scenes.results_csv import write_results

WRONG = {"add_s_mm": 40.0}
NO_ANSWER = {"status": "no_answer", "add_s_mm": None, "score": None}


def run_of(*rows: Answer, label: str = "") -> LoadedRun:
    return LoadedRun(label, BatchIndex(Path("run"), resolve({}), BatchInfo(), rows))


def test_an_object_without_an_answer_is_not_found() -> None:
    numbers = numbers_of(run_of(row(1), row(2, **WRONG), row(3, **NO_ANSWER), row(4)))
    assert numbers.recall == 0.5
    assert numbers.n_without_answer == 1
    assert numbers.median_mm == 2.0
    assert numbers.mean_mm == pytest.approx((2 + 40 + 2) / 3)


def test_failed_frames_and_what_they_held_are_counted_apart() -> None:
    failed = answer(scene_id=1, im_id=9, status="failed", message="no depth")
    numbers = numbers_of(run_of(row(1), failed))
    assert (numbers.n_frames, numbers.n_failed_frames, numbers.n_objects) == (2, 1, 1)
    failed = [row(9, k, status="failed", add_s_mm=None, score=None, ms_total=0.0) for k in range(2)]
    left_out = row(1, 5, status="left_out", add_s_mm=None, score=None, ms_total=0.0)
    run = run_of(row(1), *failed, left_out)
    numbers = numbers_of(run)
    assert (numbers.n_failed_frames, numbers.n_objects, numbers.n_in_failed_frames, numbers.n_left_out) == (1, 4, 2, 1)
    assert numbers.recall == 1 / 4
    assert run.failures == ()
    assert headline(run, numbers) == (
        "rir got 1 of 4 objects right (error below 10 % of the diameter); 1 left out as their mask or model cannot be "
        "used, 1 of 2 frames failed as a whole with 2 objects."
    )


def test_a_run_that_is_half_done_says_so_in_its_headline(tmp_path: Path) -> None:
    run = load(write_run(tmp_path / "a", [row(1), row(2)]))
    half = replace(run.index, notes=("2 of 5 frames are finished",))
    assert headline(LoadedRun("", half), numbers_of(run)).endswith(" 2 of 5 frames are finished.")


def test_solving_takes_as_long_as_results_csv_says(tmp_path: Path) -> None:
    rows = [row(1, 0), row(1, 1), row(2, 0), row(3, 0, **NO_ANSWER), row(9, status="failed", add_s_mm=None)]
    folder = write_run(tmp_path / "a", rows)
    stages_ms = {"read": 900.0, "start": 300.0, "iterate": 100.0, "record": 500.0}
    for k, record in enumerate(list(Runs(folder / "runs").records(["1/1", "1/2", "1/3", "1/9"])), start=1):
        end = replace(record.end, stages_ms={name: k * ms for name, ms in stages_ms.items()})
        written(folder, replace(record, end=end))
    run = load(folder)
    # The time of results.csv is that of first scores and iterations, of images with an answer.
    assert numbers_of(run).solving_ms == pytest.approx(600.0)
    write_results(tmp_path / "results.csv", list(run_rows(run, run.frames)))
    assert read_pose_table(tmp_path / "results.csv").mean_time_s == pytest.approx(0.6)


def test_search_trees_do_not_count_refiner_calls() -> None:
    run = LoadedRun("", BatchIndex(Path("run"), resolve({"method": {"name": "physim_mcts"}}), BatchInfo(), (row(1),)))
    assert numbers_of(run).calls_per_object is None
    assert numbers_of(run_of(row(1))).calls_per_object == 25.0


def test_objects_are_counted_by_model_with_their_most_frequent_cause() -> None:
    rows = row(1, 0, cause="pool"), row(2, 0, cause="score"), row(3, 0, cause="score"), row(1, 1)
    first, second = by_object(run_of(*rows), {1: 0.25})
    assert (first.obj_id, first.numbers.n_objects, first.most_frequent_cause, first.numbers.ar) == (1, 3, "score", 0.25)
    assert (second.obj_id, second.numbers.ar, second.most_frequent_cause) == (2, None, "")


@given(st.lists(st.none() | st.floats(0, 100), min_size=1, max_size=20))
def test_recall_never_falls_and_agrees_with_the_headline(errors_mm: list[float | None]) -> None:
    rows = [row(k, **({"add_s_mm": e} if e is not None else NO_ANSWER)) for k, e in enumerate(errors_mm)]
    curve = recall_curve(rows)
    assert (np.diff(curve) >= 0).all()
    at_ten = curve[np.argmin(abs(THRESHOLDS - 0.1))]
    assert at_ten == pytest.approx(numbers_of(run_of(*rows)).recall, abs=sum(e == 10.0 for e in errors_mm))


def test_stages_add_up(tmp_path: Path) -> None:
    times = stage_times(load(write_run(tmp_path / "a", [row(1, 0), row(1, 1), row(2, 0), row(2, 1)])))
    assert sum(times.values()) == pytest.approx(30.0 + 10.0 + 200.0)
    assert times["refine"] == pytest.approx(20.0)
    assert list(times)[:2] == ["read", "start"]


def test_the_preparation_of_models_has_a_time_of_its_own(tmp_path: Path) -> None:
    run = load(write_run(tmp_path / "a", [row(1, 0)]))
    totals = run.index.run.totals
    stages = {**totals.mean_stages_ms_per_frame, "prepare": 900.0}
    first_use = totals.model_copy(update={"mean_stages_ms_per_frame": stages})
    index = replace(run.index, run=run.index.run.model_copy(update={"totals": first_use}))
    times = stage_times(replace(run, index=index))
    assert list(times)[:3] == ["read", "prepare", "start"]
    assert (times["read"], times["prepare"]) == (30.0, 900.0)
    assert "prepare models" in {bar.name.partition(" (")[0] for bar in time_figure([replace(run, index=index)]).data}


def test_who_got_better_and_who_got_worse(tmp_path: Path) -> None:
    a = [row(1, 0, **WRONG), row(1, 1), row(2, 0, **NO_ANSWER), row(2, 1), row(3, 0), row(4, 0)]
    b = [row(1, 0), row(1, 1, add_s_mm=2.1), row(2, 0), row(2, 1, **WRONG), row(3, 0, **NO_ANSWER), row(5, 0)]
    found = difference(*load_pair(write_run(tmp_path / "a", a), write_run(tmp_path / "b", b)))
    assert [(c.frame, c.turned) for c in found.better] == [("1/2", "now right"), ("1/1", "now right")]
    assert [(c.frame, c.turned) for c in found.worse] == [("1/3", "now wrong"), ("1/2", "now wrong")]
    assert (found.only_a, found.only_b) == (1, 1)
    assert found.better[0].by == -math.inf
    assert {f.frame: (f.n_right_a, f.n_right_b) for f in found.frames} == {"1/1": (1, 2), "1/2": (1, 1), "1/3": (1, 0)}
