"""The rows of a batch: what they say, and that they survive their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.batch.rows import (
    FrameResult,
    ObjectRow,
    failed_frame,
    frame_ids,
    frame_name,
    read_frames_csv,
    write_frames_csv,
)
from verefine_viz.batch.summary import MUCH, frame_result, worst_iteration
from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.settings import MethodSettings, PhysicsSettings, Session
from verefine_viz.evaluation.errors import pose_errors
from verefine_viz.methods.registry import make_method
from verefine_viz.session.engine import Run

finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
rows = st.builds(
    ObjectRow,
    scene_id=st.integers(0, 10**6),
    im_id=st.integers(0, 10**6),
    instance_id=st.none() | st.integers(0, 99),
    name=st.text(st.characters(codec="utf-8", exclude_characters="\r\x00"), max_size=20),
    status=st.sampled_from(["ok", "no_answer", "failed"]),
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
    return run, frame_result(run, session or Session())


@given(st.lists(rows, max_size=3), finite)
def test_a_result_survives_the_journal(objects: list[ObjectRow], seconds: float) -> None:
    result = FrameResult(frame="3/14", failed=False, seconds=seconds, objects=tuple(objects))
    assert FrameResult.model_validate_json(result.model_dump_json()) == result


@given(rows)
def test_frames_csv_is_read_as_it_was_written(tmp_path_factory: pytest.TempPathFactory, row: ObjectRow) -> None:
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
    assert frame_ids("50/1") == (50, 1)
    assert frame_name("50/1") == "000050_000001"


def test_a_failed_frame_is_one_row_with_one_line() -> None:
    result = failed_frame("2/7", "first\nsecond  third")
    (row,) = result.objects
    assert result.failed
    assert (row.scene_id, row.im_id, row.status, row.message) == (2, 7, "failed", "first second third")


def test_a_row_per_object_says_what_the_run_did() -> None:
    run, result = solved(box_problem(n_hypotheses=3, n_instances=2))
    assert [row.instance_id for row in result.objects] == [0, 1]
    for row, best in zip(result.objects, run.final_state.best, strict=True):
        mine = [i for i in run.iterations if i.instance_id == row.instance_id]
        assert row.status == "ok"
        assert row.n_iterations == len(mine) == 9
        assert row.n_hypotheses == 3
        assert row.score == best.score.score
        assert (row.best_arm, row.best_iteration) == (best.arm, best.iteration)
        assert row.initial_score is not None
        assert row.score > row.initial_score
        assert row.add_s_mm is not None
        assert row.initial_add_s_mm is not None
        assert row.add_s_mm < row.initial_add_s_mm
        n_events = sum(len(i.events) for i in mine)
        assert sum(int(word.split()[1]) for word in row.events.split("; ") if word) == n_events


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
    expected = worst if growth[worst] > MUCH * target.model.diameter_m * 1e3 else result.objects[0].best_iteration
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
    (row,), (target,), (best,) = result.objects, run.problem.targets, run.final_state.best
    assert row.worst_iteration == 2
    assert row.best_iteration != 2
    assert best is not None
    blind = replace(target, instance=replace(target.instance, T_cam_obj_gt=None))
    assert worst_iteration(blind, best, run.iterations) == 2


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
