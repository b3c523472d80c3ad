"""Key moments of runs: how many, in what order, with which poses and words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from msgspec import structs

from tests.fakes import FakeRefiner, FakeSimulator, FakeVerifier, box_problem
from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.moment import Moment
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.diagnosis.key_moments import MOST_WORDS, key_moments
from verefine_viz.methods.known_methods import METHODS
from verefine_viz.methods.registry import make_method
from verefine_viz.run.engine import Run
from verefine_viz.run.record import Answer, RunRecord

NAMES = [name for name, info in METHODS.items() if not (info.repeats or info.has_tree)]
LONG = "a detail of very many words that cannot stand below a picture as it is, whatever is done"


def finished(name: str) -> tuple[RunRecord, list[Answer]]:
    """The record of a finished run on boxes, and its answers without findings."""
    session = Session(method=MethodSettings(name=name, iterations=3))
    method = make_method(session.method, FakeSimulator(), FakeRefiner(), FakeVerifier(), 2)
    run = Run(method, box_problem(3, 2))
    run.finish()
    answers = [
        Answer(
            frame="0/0",
            instance_id=target.instance.instance_id,
            status="ok",
            T_cam_obj=best.T_cam_obj,
            score=best.score.score,
            best_hypothesis=best.arm + 1,
            best_iteration=best.iteration,
        )
        for target, best in zip(run.problem.targets, run.final_state.best, strict=True)
        if best is not None
    ]
    return run.record(session, {}), answers


def with_every_finding(record: RunRecord, answer: Answer) -> Iterator[Answer]:
    """The answer without a finding, and with one of each cause at each kind of iteration."""
    own = [i for i in record.iterations if i.instance_id == answer.instance_id]
    yield answer
    assert answer.score is not None
    first = own[0].stages[0].score
    numbers = {"hypothesis": 0, "nearest": 0, "nearest_error": 0.5, "nearest_rotation_deg": 90, "error_before": 0.1}
    numbers |= {"iteration": own[0].index, "score_of_ground_truth": 0.9, "iterations_of_it": 1}
    numbers |= {"margin": answer.score - (first.score if first is not None else 0.0)}
    for cause in Cause:
        for at in (None, 0, own[0].index, own[-1].index):
            finding = Finding(cause, "", numbers, iteration=at, detail=f": {LONG}")
            yield structs.replace(answer, findings=(finding,), add_s_mm=40.0, initial_add_s_mm=50.0)


def poses_of(record: RunRecord, answer: Answer) -> set[bytes]:
    """Every pose of an object that the record has."""
    one = next(o for o in record.header.objects if o.instance_id == answer.instance_id)
    own = [i for i in record.iterations if i.instance_id == answer.instance_id]
    poses = [*(h.T_cam_obj for h in one.hypotheses), answer.T_cam_obj, one.T_cam_obj_gt]
    poses += [T for i in own for T in (*(s.T_cam_obj for s in i.stages), i.best.T_cam_obj)]
    return {T.tobytes() for T in poses if T is not None}


def without_truth(record: RunRecord) -> RunRecord:
    objects = tuple(structs.replace(one, T_cam_obj_gt=None) for one in record.header.objects)
    return structs.replace(record, header=structs.replace(record.header, objects=objects))


def check(moments: tuple[Moment, ...], record: RunRecord, answer: Answer) -> None:
    assert 4 <= len(moments) <= 6
    assert [m.iteration for m in moments] == sorted(m.iteration for m in moments)
    assert (moments[0].iteration, moments[-1].iteration) == (0, len(record.iterations))
    known = poses_of(record, answer)
    for moment in moments:
        assert 1 <= len(moment.caption.split()) <= MOST_WORDS
        assert {T.tobytes() for _, T in moment.poses} <= known
        stages = [s.name for i in record.iterations if i.index == moment.iteration for s in i.stages]
        assert moment.stage is None or moment.stage in stages


@pytest.mark.parametrize("name", NAMES)
def test_four_to_six_moments_of_any_run_and_cause(name: str) -> None:
    record, answers = finished(name)
    n = 0
    for answer in answers:
        for told in with_every_finding(record, answer):
            if moments := key_moments(record, told):
                check(moments, record, told)
                n += 1
    assert n


@pytest.mark.parametrize("name", NAMES)
def test_without_ground_truth_none_refers_to_it(name: str) -> None:
    record, answers = finished(name)
    record = without_truth(record)
    for answer in answers:
        other = np.array(answer.T_cam_obj)
        other[0, 3] += 0.1
        for beside in (None, other):
            moments = key_moments(record, answer, beside)
            roles = {role for moment in moments for role, _ in moment.poses}
            assert "ground truth" not in roles
            assert ("runner-up" in roles) == (beside is not None)
            assert not any("truth" in f"{moment.title} {moment.caption}".lower() for moment in moments)


def test_a_pose_given_up_is_the_one_that_scored_so() -> None:
    record, answers = finished("rir")
    own = [i for i in record.iterations if i.instance_id == answers[0].instance_id]
    stage = own[0].stages[-1]
    assert stage.score is not None
    assert answers[0].score is not None
    numbers = {"hypothesis": own[0].arm, "iteration": own[0].index, "margin": answers[0].score - stage.score.score}
    finding = Finding(Cause.DISCARDED, "", numbers, iteration=own[-1].index)
    _, before, after, *_ = key_moments(record, structs.replace(answers[0], findings=(finding,)))
    assert (before.iteration, before.poses[0][0]) == (own[0].index, stage.name)
    assert after.iteration == own[-1].index
    assert after.poses[0][1] is own[-1].best.T_cam_obj
