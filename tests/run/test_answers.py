"""The answers of a run: what they say, and the tables made of them."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from tests.made_runs import answer, finished
from verefine_viz.batch.summary import run_end, worst_iteration
from verefine_viz.core.arrays import Float
from verefine_viz.core.finding import Finding
from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import LeftOut, Placed, Problem, Target
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.methods.registry import make_method
from verefine_viz.run.answers import COLUMNS, HEADER, result_rows, solving_s, table_lines
from verefine_viz.run.engine import Run
from verefine_viz.run.record import Answer, RunEnd, RunRecord, Status
from verefine_viz.run.run_header import failed_run, header_of
from verefine_viz.run.session_file import load_session, resolve
from verefine_viz.run.toolbox import Toolbox

number = st.floats(allow_nan=False, allow_infinity=False, width=64)
text = st.text(st.characters(codec="utf-8", exclude_characters="\r\x00"), max_size=20)
answers = st.builds(
    Answer,
    frame=st.builds("{}/{}".format, st.integers(0, 10**6), st.integers(0, 10**6)),
    instance_id=st.none() | st.integers(0, 99),
    obj_id=st.none() | st.integers(1, 99),
    name=text,
    method=text,
    seed=st.none() | st.integers(0, 9),
    visib_fract=st.none() | st.floats(0, 1),
    has_truth=st.booleans(),
    status=st.sampled_from(get_args(Status)),
    T_cam_obj=st.none() | st.builds(np.eye, st.just(4)),
    score=st.none() | number,
    initial_score=st.none() | number,
    add_s_mm=st.none() | st.floats(0, 1e6),
    best_iteration=st.none() | st.integers(0, 10**6),
    n_hypotheses=st.integers(0, 99),
    ms_total=st.floats(0, 1e9),
    findings=st.lists(st.builds(Finding, cause=text, text=text), max_size=2).map(tuple),
    doubts=st.lists(text, max_size=2).map(tuple),
    message=text,
)


def table(records: Sequence[RunRecord], folder: Path) -> list[dict[str, str]]:
    """The rows of frames.csv."""
    (folder / "frames.csv").write_text(HEADER + "".join(map(table_lines, records)))
    with (folder / "frames.csv").open(encoding="utf-8", newline="") as file:
        return [*csv.DictReader(file)]


def solved(
    problem: Problem, method: str = "rir", refiner: FakeRefiner | None = None, session: Session | None = None
) -> tuple[Run, RunEnd]:
    chosen = MethodSettings(name=method, iterations=3)
    run = Run(make_method(chosen, FakeSimulator(), refiner or FakeRefiner(), FakeVerifier(), 3), problem)
    run.finish()
    return run, run_end(run, session or Session())


def failed(message: str, objects: Sequence[LeftOut] = ()) -> RunEnd:
    record = failed_run(resolve({"method": {"name": "sir"}}), {}, "2/7", message, objects)
    assert record.end is not None
    assert record.is_complete
    return record.end


# The table


def test_every_column_is_of_an_answer_and_only_times_differ_from_run_to_run() -> None:
    names = [column.name for column in COLUMNS]
    assert len({*names}) == len(names)
    assert all(hasattr(answer(), name) for name in names)
    assert f"{','.join(names)}\n" == HEADER
    assert [c.name for c in COLUMNS if c.kind == "time"] == [name for name in names if name.startswith("ms_")]
    left = {*Answer.__struct_fields__} - {*names}
    assert left == {"frame", "T_cam_obj", "middle_m", "findings", "doubts"}


@given(answers)
def test_a_row_says_what_the_answer_says(tmp_path_factory: pytest.TempPathFactory, one: Answer) -> None:
    (row,) = table([finished(one.frame, [one])], tmp_path_factory.mktemp("csv"))
    assert f"{row['scene_id']}/{row['im_id']}" == one.frame
    for column in COLUMNS:
        value, cell = getattr(one, column.name), row[column.name]
        if value is None:
            assert cell == ""
        elif isinstance(value, float) and column.digits is None:
            assert float(cell) == value
        elif isinstance(value, float):
            assert float(cell) == pytest.approx(value, abs=5e-4 * (1 + 1e-9))
            assert len(cell.partition(".")[2]) == column.digits
        else:
            assert cell == str(value)


# results.csv


@given(st.lists(st.lists(answers, min_size=1, max_size=3), max_size=3))
def test_the_table_has_the_answers_of_all_frames_one_after_another(
    tmp_path_factory: pytest.TempPathFactory, frames: list[list[Answer]]
) -> None:
    folder = tmp_path_factory.mktemp("csv")
    records = [finished(f"0/{k}", those) for k, those in enumerate(frames)]
    rows = table(records, folder)
    assert [row["score"] for row in rows] == [str(COLUMN["score"].cell(one)) for those in frames for one in those]
    assert (folder / "frames.csv").read_bytes() == (HEADER + "".join(map(table_lines, records))).encode()


COLUMN = {column.name: column for column in COLUMNS}


def test_the_answers_are_the_results() -> None:
    run, end = solved(replace(box_problem(n_instances=2), left_out=(LeftOut(7, 3, "mug", "", has_truth=True),)))
    end = structs.replace(end, seconds=9.0, stages_ms={"read": 500.0, "start": 40.0, "iterate": 460.0})
    record = RunRecord(header_of(run.problem, run.state_at(0), Session(), {}), (), end)
    rows = [*result_rows(record)]
    assert len(rows) == 2
    for row, best, target in zip(rows, run.final_state.best, run.problem.targets, strict=True):
        assert f"{row.scene_id}/{row.im_id}" == run.problem.frame
        assert (row.obj_id, row.score, row.time_s) == (target.instance.obj_id, best.score.score, 0.5)
        np.testing.assert_array_equal(row.T_cam_obj, best.T_cam_obj)


def test_where_poses_were_only_estimated_all_hypotheses_are_results() -> None:
    problem = box_problem(n_hypotheses=3, n_instances=2)
    mine = [answer(*parse_frame(problem.frame), instance_id=k, obj_id=5) for k in (1, 0)]
    record = RunRecord(header_of(problem, None, Session(), {}), (), RunEnd(answers=tuple(mine), seconds=2.0))
    rows = [*result_rows(record)]
    expected = [h for k in (1, 0) for h in problem.targets[k].instance.hypotheses]
    assert [(row.obj_id, row.score, row.time_s) for row in rows] == [(5, h.confidence, 2.0) for h in expected]
    for row, hypothesis in zip(rows, expected, strict=True):
        np.testing.assert_array_equal(row.T_cam_obj, hypothesis.T_cam_obj)


@given(st.lists(answers, max_size=3))
def test_an_object_without_an_answer_is_no_result(those: list[Answer]) -> None:
    without = [structs.replace(one, frame="0/0", T_cam_obj=None, instance_id=None) for one in those]
    assert [*result_rows(finished("0/0", without))] == []
    failed = [structs.replace(one, frame="0/0", status="failed") for one in those]
    assert [*result_rows(finished("0/0", failed))] == []


# Answers


def test_objects_that_cannot_be_solved_have_a_row_of_their_own() -> None:
    problem = box_problem(n_hypotheses=2, n_instances=2)
    left_out = LeftOut(7, 3, "mug", "000001_000007.png is missing", has_truth=True, visib_fract=0.25)
    _, result = solved(replace(problem, left_out=(left_out,)))
    assert [row.status for row in result.answers] == ["ok", "ok", "left_out"]
    row = result.answers[-1]
    assert row.T_cam_obj is None
    assert (row.instance_id, row.obj_id, row.name, row.visib_fract, row.has_truth) == (7, 3, "mug", 0.25, True)
    assert (row.message, row.is_correct, row.was_asked_for) == ("left out: 000001_000007.png is missing", None, False)
    assert not result.can_be_mended
    _, result = solved(replace(problem, left_out=(replace(left_out, is_unreadable=True),)))
    assert (result.n_unreadable, result.can_be_mended, result.failed) == (1, True, False)


def test_a_failed_frame_has_a_row_for_each_object_that_is_known_to_be_in_it() -> None:
    end = failed("first\nsecond  third")
    (row,) = end.answers
    assert (end.failed, end.can_be_mended, row.is_object) == (True, True, False)
    assert (row.scene_id, row.im_id, row.status, row.message) == (2, 7, "failed", "first second third")
    rows = failed("no depth", [LeftOut(k, 3, "mug", "", has_truth=True) for k in range(2)]).answers
    assert [(r.instance_id, r.obj_id, r.message) for r in rows] == [(0, 3, "no depth"), (1, 3, "no depth")]
    assert all(r.is_object and r.has_truth and r.status == "failed" for r in rows)


@pytest.mark.parametrize(
    ("stages_ms", "seconds"), [({"read": 500.0, "start": 40.0, "iterate": 460.0, "record": 3000.0}, 0.5), ({}, 9.0)]
)
def test_the_time_of_a_frame_is_that_of_solving(stages_ms: dict[str, float], seconds: float) -> None:
    assert solving_s(RunEnd(answers=(), seconds=9.0, stages_ms=stages_ms)) == pytest.approx(seconds)


def test_a_row_per_object_says_what_the_run_did() -> None:
    run, result = solved(box_problem(n_hypotheses=3, n_instances=2))
    assert [row.instance_id for row in result.answers] == [0, 1]
    for row, best in zip(result.answers, run.final_state.best, strict=True):
        mine = [i for i in run.iterations if i.instance_id == row.instance_id]
        assert row.status == "ok"
        assert row.n_iterations == len(mine) == 9
        assert row.n_hypotheses == 3
        assert row.score == best.score.score
        assert row.colour_fit is None
        assert (row.best_hypothesis, row.best_iteration) == (best.arm + 1, best.iteration)
        assert row.initial_score is not None
        assert row.score > row.initial_score
        assert row.add_s_mm is not None
        assert row.initial_add_s_mm is not None
        assert row.add_s_mm < row.initial_add_s_mm
        n_events = sum(len(i.events) for i in mine)
        assert sum(int(word.split()[1]) for word in row.events.split("; ") if word) == n_events


@dataclass(frozen=True)
class SeesColour(FakeVerifier):
    """A verifier of objects that have colour."""

    def score(self, target: Target, Ts_cam_obj: Float, placed: Sequence[Placed] = ()) -> Scores:
        scores = super().score(target, Ts_cam_obj, placed)
        return replace(scores, colour_fit=scores.score / 2, colour_weight=0.1)


def test_a_row_has_the_colour_fit_of_its_answer_where_colour_counts() -> None:
    problem = box_problem()
    run = Run(make_method(MethodSettings(iterations=3), FakeSimulator(), FakeRefiner(), SeesColour(), 3), problem)
    run.finish()
    (row,) = run_end(run, Session()).answers
    assert row.score is not None
    assert row.colour_fit == row.score / 2


@dataclass(frozen=True)
class Straying(FakeRefiner):
    """Moves the object 50 mm aside in its second call."""

    calls: Iterator[int] = field(default_factory=lambda: count(1))

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        T = super().refine(target, T_cam_obj, fixed)
        return transform(np.eye(3), [0.05, 0, 0]) @ T if next(self.calls) == 2 else T


def test_an_iteration_that_loses_much_is_named_by_its_error_or_its_score() -> None:
    run, result = solved(box_problem(), "pir", Straying())
    (row,), (target,) = result.answers, run.problem.targets
    assert row.worst_iteration == 2
    assert row.best_iteration != 2
    blind = replace(target, instance=replace(target.instance, T_cam_obj_gt=None))
    assert worst_iteration(blind, run.iterations) == 2
    _, steady = solved(box_problem(), "pir")
    assert steady.answers[0].worst_iteration is None


@pytest.mark.parametrize("enabled", [True, False])
def test_a_plane_that_is_missing_is_said_where_physics_was_asked_for(enabled: bool) -> None:
    problem = box_problem(n_instances=2)
    seen = replace(problem.observation, support=None, support_note="no plane was found")
    _, result = solved(replace(problem, observation=seen), session=Session(physics=PhysicsSettings(enabled=enabled)))
    said = ("no physics: no plane was found",) if enabled else ()
    assert result.notes == said
    assert {row.message for row in result.answers} == set(said or [""])


def test_an_empty_pool_is_no_answer_and_no_failure() -> None:
    _, result = solved(box_problem(n_hypotheses=0))
    (row,) = result.answers
    assert not result.failed
    assert (row.status, row.score, row.message) == ("no_answer", None, "no hypothesis to start from")
    assert row.T_cam_obj is None


def test_an_answer_that_is_right_by_add_s_only_says_so() -> None:
    sessions = Path(__file__).resolve().parents[2] / "sessions"
    # A slim box that leans by 24°: each of its points is near some point of the upright one.
    toolbox = Toolbox(load_session(sessions / "failure_simulation_topples.toml", {"method": {"name": "rir"}}))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    (row,) = run_end(run, toolbox.session).answers
    assert row.is_correct
    assert row.message.startswith("right by ADD-S only: ADD over the declared symmetries is 1")
