"""The rows of a batch: what they say, and that they survive their files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.changing import replace
from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem

# NAMES FrameResult,Answer,failed_frame,file_stem,read_frames_csv,with_objects,write_frames_csv
from verefine_viz.batch.summary import MUCH, run_end, worst_iteration
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import LeftOut, Placed, Problem, Target
from verefine_viz.core.scores import Scores
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.methods.registry import make_method
from verefine_viz.run.engine import Run
from verefine_viz.run.session_file import load_session
from verefine_viz.run.toolbox import Toolbox

finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
rows = st.builds(
    Answer,
    scene_id=st.integers(0, 10**6),
    im_id=st.integers(0, 10**6),
    instance_id=st.none() | st.integers(0, 99),
    name=st.text(st.characters(codec="utf-8", exclude_characters="\r\x00"), max_size=20),
    status=st.sampled_from(["ok", "no_answer", "left_out", "failed"]),
    score=st.none() | finite,
    add_s_mm=st.none() | st.floats(0, 1e6),
    message=st.text(max_size=20),
)


def solved(
    problem: Problem, method: str = "rir", refiner: FakeRefiner | None = None, session: Session | None = None
) -> tuple[Run, FrameResult]:
    chosen = MethodSettings(name=method, iterations=3)
    run = Run(make_method(chosen, FakeSimulator(), refiner or FakeRefiner(), FakeVerifier(), 3), problem)
    run.finish()
    return run, run_end(run, session or Session())


@given(st.lists(rows, max_size=3), finite)
def test_a_result_survives_the_journal(objects: list[Answer], seconds: float) -> None:
    result = FrameResult(frame="3/14", failed=False, seconds=seconds, objects=tuple(objects))
    assert FrameResult.model_validate_json(result.model_dump_json()) == result


def test_a_table_of_another_version_is_refused_in_one_clear_line(tmp_path: Path) -> None:
    file = tmp_path / "frames.csv"
    write_frames_csv(file, [failed_frame("2/7", "no depth")])
    file.write_text(file.read_text().replace("best_hypothesis", "best_arm"))
    with pytest.raises(InputError, match=r"another version wrote it \(its columns differ: best_arm, best_hypothesis\)"):
        read_frames_csv(file)


def with_score(value: str) -> Callable[[str], str]:
    return lambda text: text.replace(",0.5,", f",{value},", 1)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (with_score("nan"), "line 2: score = 'nan': input should be a finite number"),
        (with_score("-inf"), "line 2: score = '-inf': input should be a finite number"),
        (with_score("high"), "line 2: score = 'high': input should be a valid number"),
        (with_score("x" * 200_000), "field larger than field limit (131072)"),
        (with_score("9" * 100_000), "line 2: score = '999"),
        (lambda text: text.replace("ok", "perhaps"), "line 2: status = 'perhaps': input should be 'ok', "),
        (lambda text: text[: len(text) - 20], "its end is missing"),
        (lambda text: text[: len(text) - 5], "its end is missing"),
        (lambda text: text[: len(text) // 2], "its end is missing"),
        (lambda text: text[: len(text) - 20] + "\n", "line 2: it does not have "),
        (lambda text: text.rstrip() + ",1,2\n", "line 2: it does not have "),
        (lambda text: text.replace("ok", "o\x00k"), "line "),
        (lambda text: text.replace("ok", "\udcff"), "line "),
        (lambda text: "", "the file is empty"),
    ],
)
def test_a_damaged_table_is_refused_in_one_line(change: Callable[[str], str], why: str, tmp_path: Path) -> None:
    file = tmp_path / "frames.csv"
    row = answer(scene_id=0, im_id=0, status="ok", score=0.5, message="all is well")
    write_frames_csv(file, [FrameResult(frame="0/0", failed=False, seconds=0, objects=(row,))])
    file.write_bytes(change(file.read_text()).encode(errors="surrogateescape"))
    with pytest.raises(InputError) as refused:
        read_frames_csv(file)
    said = str(refused.value)
    assert said.startswith(f"{file} is not what a batch writes: ")
    assert why in said
    assert said.endswith("; the same batch command writes it again")
    assert len(said.splitlines()) == 1
    assert len(said) < 400 + len(str(file))


@pytest.mark.parametrize("name", ["frames.csv", "pipe", "folder"])
def test_what_is_no_table_is_refused_at_once(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"does not exist|is a pipe, expected a file|is a folder, expected a file"):
        read_frames_csv(tmp_path / name)


@given(rows)
def test_frames_csv_is_read_as_it_was_written(tmp_path_factory: pytest.TempPathFactory, row: Answer) -> None:
    file = tmp_path_factory.mktemp("csv") / "frames.csv"
    row = row.model_copy(update={"message": " ".join(row.message.split())})
    write_frames_csv(file, [FrameResult(frame="0/0", failed=False, seconds=0, objects=(row,))])
    (read,) = read_frames_csv(file)
    assert read.name == row.name
    assert read.message == row.message
    assert (read.scene_id, read.im_id, read.instance_id, read.status) == (
        row.scene_id,
        row.im_id,
        row.instance_id,
        row.status,
    )
    assert read.score == row.score
    assert (read.add_s_mm is None) == (row.add_s_mm is None)
    if row.add_s_mm is not None:
        assert read.add_s_mm == pytest.approx(row.add_s_mm, abs=5e-4 * (1 + 1e-9))


def test_frame_names() -> None:
    assert file_stem("50/1") == "000050_000001"


def test_a_failed_frame_is_one_row_with_one_line() -> None:
    result = failed_frame("2/7", "first\nsecond  third")
    (row,) = result.objects
    assert result.failed
    assert (row.scene_id, row.im_id, row.status, row.message) == (2, 7, "failed", "first second third")


def test_objects_that_cannot_be_solved_have_a_row_of_their_own() -> None:
    problem = box_problem(n_hypotheses=2, n_instances=2)
    left_out = LeftOut(7, 3, "mug", "000001_000007.png is missing", has_truth=True, visib_fract=0.25)
    _, result = solved(replace(problem, left_out=(left_out,)))
    assert [row.status for row in result.objects] == ["ok", "ok", "left_out"]
    row = result.objects[-1]
    assert (row.instance_id, row.obj_id, row.name, row.visib_fract, row.has_truth) == (7, 3, "mug", 0.25, True)
    assert (row.message, row.is_correct, row.was_asked_for) == ("left out: 000001_000007.png is missing", None, False)
    assert len(result.estimates) == 2
    assert not result.can_be_mended


def test_files_that_cannot_be_read_are_counted_as_what_somebody_can_mend() -> None:
    problem = box_problem(n_hypotheses=2, n_instances=2)
    left_out = [LeftOut(k, 3, "mug", "", has_truth=True, is_unreadable=k > 2) for k in (2, 3, 4)]
    _, result = solved(replace(problem, left_out=tuple(left_out)))
    assert (result.n_unreadable, result.can_be_mended, result.failed) == (2, True, False)


def test_a_failed_frame_has_a_row_for_each_object_that_is_known_to_be_in_it() -> None:
    failed = failed_frame("2/7", "no depth")
    assert with_objects(failed, ()) == failed
    assert not failed.objects[0].is_object
    objects = [LeftOut(k, 3, "mug", "", has_truth=True) for k in range(2)]
    rows = with_objects(failed, objects).objects
    assert [(row.instance_id, row.obj_id, row.status, row.message) for row in rows] == [
        (k, 3, "failed", "no depth") for k in range(2)
    ]
    assert all(row.is_object and row.has_truth for row in rows)


@pytest.mark.parametrize(
    ("stages_ms", "seconds"), [({"read": 500.0, "start": 40.0, "iterate": 460.0, "record": 3000.0}, 0.5), ({}, 9.0)]
)
def test_the_time_of_a_frame_is_that_of_solving(stages_ms: dict[str, float], seconds: float) -> None:
    result = FrameResult(frame="0/0", failed=False, seconds=9.0, objects=(), stages_ms=stages_ms)
    assert result.solving_s == pytest.approx(seconds)


def test_a_row_per_object_says_what_the_run_did() -> None:
    run, result = solved(box_problem(n_hypotheses=3, n_instances=2))
    assert [row.instance_id for row in result.objects] == [0, 1]
    for row, best in zip(result.objects, run.final_state.best, strict=True):
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
    (row,) = run_end(run, Session()).objects
    assert row.score is not None
    assert row.colour_fit == row.score / 2


def test_the_estimates_are_the_best_poses() -> None:
    run, result = solved(box_problem(n_instances=2))
    for estimate, best in zip(result.estimates, run.final_state.best, strict=True):
        assert estimate.T_cam_obj == tuple(best.T_cam_obj.ravel())
        assert estimate.score == best.score.score


def test_the_worst_iteration_is_the_one_that_lost_most() -> None:
    problem = box_problem(n_hypotheses=3)
    run, result = solved(problem)
    (target,) = problem.targets
    T_gt = target.instance.T_cam_obj_gt
    assert T_gt is not None
    growth = {
        i.index: pose_errors(target.model, i.accepted_stage.T_cam_obj, T_gt).add_s_mm
        - pose_errors(target.model, i.stages[0].T_cam_obj, T_gt).add_s_mm
        for i in run.iterations
    }
    worst = max(growth, key=lambda k: growth[k])
    expected = worst if growth[worst] > MUCH * target.model.diameter_m * 1e3 else None
    assert result.objects[0].worst_iteration == expected


@dataclass(frozen=True)
class Straying(FakeRefiner):
    """Moves the object 50 mm aside in its second call."""

    calls: Iterator[int] = field(default_factory=lambda: count(1))

    def refine(self, target: Target, T_cam_obj: Float, fixed: Sequence[Placed] = ()) -> Float:
        T = super().refine(target, T_cam_obj, fixed)
        return transform(np.eye(3), [0.05, 0, 0]) @ T if next(self.calls) == 2 else T


def test_an_iteration_that_loses_much_is_named_by_its_error_or_its_score() -> None:
    run, result = solved(box_problem(), "pir", Straying())
    (row,), (target,) = result.objects, run.problem.targets
    assert row.worst_iteration == 2
    assert row.best_iteration != 2
    blind = replace(target, instance=replace(target.instance, T_cam_obj_gt=None))
    assert worst_iteration(blind, run.iterations) == 2


def test_where_no_iteration_loses_much_none_is_named() -> None:
    run, result = solved(box_problem(), "pir")
    assert len(run.iterations) > 0
    assert result.objects[0].worst_iteration is None


@pytest.mark.parametrize("enabled", [True, False])
def test_a_plane_that_is_missing_is_said_where_physics_was_asked_for(enabled: bool) -> None:
    problem = box_problem(n_instances=2)
    seen = replace(problem.observation, support=None, support_note="no plane was found")
    _, result = solved(replace(problem, observation=seen), session=Session(physics=PhysicsSettings(enabled=enabled)))
    said = ("no physics: no plane was found",) if enabled else ()
    assert result.notes == said
    assert {row.message for row in result.objects} == set(said or [""])


def test_an_empty_pool_is_no_answer_and_no_failure() -> None:
    _, result = solved(box_problem(n_hypotheses=0))
    (row,) = result.objects
    assert not result.failed
    assert (row.status, row.score, row.message) == ("no_answer", None, "no hypothesis to start from")
    assert result.estimates == ()


def test_an_answer_that_is_right_by_add_s_only_says_so() -> None:
    sessions = Path(__file__).resolve().parents[2] / "sessions"
    # A slim box that leans by 24°: each of its points is near some point of the upright one.
    toolbox = Toolbox(load_session(sessions / "failure_simulation_topples.toml", {"method": {"name": "rir"}}))
    run = toolbox.run(toolbox.problem(toolbox.frames[0]))
    run.finish()
    (row,) = run_end(run, toolbox.session).objects
    assert row.is_correct
    assert row.message.startswith("right by ADD-S only: ADD over the declared symmetries is 1")
