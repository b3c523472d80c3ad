"""Signs of a fault that need no re-run: which there are, and in what order."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.fakes import box_problem
from verefine_viz.core.accuracy import PoseErrors
from verefine_viz.core.arrays import Float
from verefine_viz.core.causes import Cause
from verefine_viz.core.finding import Finding
from verefine_viz.core.geometry import transform
from verefine_viz.core.records import Best, Event, Iteration, Stage, StageName
from verefine_viz.core.scores import PoseScore
from verefine_viz.core.settings import MethodSettings, Session
from verefine_viz.diagnosis.lost_poses import Discarded, Lost, lost
from verefine_viz.diagnosis.signs import FinishedObject, RunnerUp, signs
from verefine_viz.diagnosis.undeclared_turn import UndeclaredTurn

C = Cause
TARGET = box_problem(n_hypotheses=3).targets[0]
SESSION = Session(method=MethodSettings(name="rir"))


def errors(relative: float) -> PoseErrors:
    """Of an object of 100 mm."""
    mm = 100 * relative
    return PoseErrors(0.0, mm, mm, mm, mm, relative)


def score(value: float, missed: int = 0) -> PoseScore:
    return PoseScore(value, value, value, 100, 100, (100 - missed, missed, 0, 0, 0))


def best(value: float, missed: int = 0) -> Best:
    return Best(np.eye(4), score(value, missed), 0, 3, "refined")


def wrong(at_gt: float = 0.9, missed_at_gt: int = 0, **known: Any) -> FinishedObject:
    """A wrong answer that scores 0.8; the second hypothesis starts nearest, and all had their share."""
    o = FinishedObject(
        TARGET,
        "box",
        best(0.8),
        errors(0.5),
        starts=(errors(0.6), errors(0.2)),
        n_tried=(5, 5),
        score_at_gt=score(at_gt, missed_at_gt),
    )
    return replace(o, **known)


def unknown(value: float = 0.8, missed: int = 0, **known: Any) -> FinishedObject:
    """An answer without ground truth."""
    return replace(FinishedObject(TARGET, "box", best(value, missed)), **known)


def given_up(margin: float) -> Discarded:
    stage = Stage("refined", np.eye(4), score(0.8 - margin))
    return Discarded(1, 2, stage, score(0.8 - margin), 3, best(0.8))


LOST = Lost(0.05, score(0.7), 1, 2, 0.4, 0.0, False, 0)
TURNED = UndeclaredTurn(180.0, 0.5, 0.01)
IMPOSSIBLE = Finding(C.IMPOSSIBLE, "The box cannot lie where its answer has it. Sinks 9.0 mm into the mug.")
FAR = (errors(0.6), errors(0.4))


@pytest.mark.parametrize(
    ("o", "causes"),
    [
        (wrong(), [C.BUDGET]),
        (wrong(n_tried=(9, 1)), [C.ARM_STARVED]),
        (wrong(n_tried=(8, 2)), [C.BUDGET]),
        (wrong(0.8, n_tried=(9, 1)), [C.SCORE]),
        (wrong(starts=FAR), [C.POOL]),
        (wrong(lost=LOST, n_tried=(9, 1)), [C.ARM_STARVED, C.REFINER]),
        (wrong(lost=replace(LOST, added_by_simulation=0.5)), [C.SIMULATION]),
        (wrong(0.7, 30, lost=LOST), [C.MASK, C.SCORE, C.REFINER]),
        (wrong(discarded=given_up(0.1), lost=LOST, starts=FAR), [C.DISCARDED]),
        (wrong(0.79, discarded=given_up(0.1)), [C.SCORE, C.DISCARDED]),
        (wrong(0.79, discarded=given_up(0.01)), [C.DISCARDED, C.SCORE]),
        (wrong(0.1, 80, undeclared=TURNED, starts=FAR), [C.GROUND_TRUTH]),
        (wrong(0.7, 30, undeclared=TURNED, starts=FAR, lost=LOST), [C.SYMMETRIC]),
        (wrong(errors=errors(0.05)), []),
        (wrong(answer=None), []),
        (unknown(), []),
        (unknown(0.45), []),
        (unknown(0.8, 24), []),
        (unknown(0.44), [C.POOL]),
        (unknown(0.44, 25, impossible=IMPOSSIBLE), [C.IMPOSSIBLE, C.POOL, C.MASK]),
        (unknown(runner_up=RunnerUp(best(0.79), 0.01, 40.0)), [C.AMBIGUOUS]),
        (unknown(runner_up=RunnerUp(best(0.79), 0.01, 1.0)), []),
        (unknown(runner_up=RunnerUp(best(0.7), 0.1, 40.0)), []),
    ],
)
def test_signs_are_ordered(o: FinishedObject, causes: list[Cause]) -> None:
    found = signs(o, SESSION)
    assert [sign.cause for sign in found] == causes
    for sign in found:
        assert sign.text.endswith(".")
        assert not sign.is_confirmed, "nothing was run again"


def test_a_starved_hypothesis_is_tried_with_more_exploration_where_there_is_any() -> None:
    for name, is_tried in (("rir", True), ("even", False)):
        (sign,) = signs(wrong(n_tried=(9, 1)), Session(method=MethodSettings(name=name)))
        assert (sign.try_ is not None) == ("exploration" in sign.text) == is_tried
        assert sign.numbers["iterations_of_it"] == 1


def test_a_plane_in_doubt_comes_before_the_simulation_on_it() -> None:
    support = TARGET.observation.support
    assert support is not None
    doubted = replace(TARGET, observation=replace(TARGET.observation, support=replace(support, inlier_share=0.26)))
    pushed = replace(LOST, added_by_simulation=0.5, n_unstable=2)
    found = signs(wrong(lost=pushed, target=doubted), SESSION)
    assert [sign.cause for sign in found] == [C.PLANE, C.SIMULATION]
    assert [sign.iteration for sign in found] == [2, 2]


# Near poses that a run had, and what led it away from them.


def at(relative: float) -> Float:
    """A pose that is off by this share of the diameter."""
    return transform(np.eye(3), [0, 0, 0.1 * relative])


def iteration(index: int, *stages: tuple[StageName, float, float], unstable: bool = False) -> Iteration:
    """Stages as (name, error, score); the last one is accepted, and the best."""
    name, off, value = stages[-1]
    return Iteration(
        index,
        0,
        1,
        0,
        index,
        tuple(Stage(name, at(off), score(value)) for name, off, value in stages),
        name,
        Best(at(off), score(value), 0, index, name),
        events=(Event("unstable", "Tipped over."),) if unstable else (),
    )


def test_a_near_pose_is_lost_by_what_added_most_to_its_error() -> None:
    def error_of(T_cam_obj: Float) -> float:
        return 10 * float(T_cam_obj[2, 3])

    near = iteration(1, ("current", 0.2, 0.5), ("refined", 0.01, 0.9))
    pushed = iteration(2, ("current", 0.01, 0.9), ("simulated", 0.3, 0.2), ("refined", 0.31, 0.3), unstable=True)
    away = lost([near, pushed], pushed.best, error_of)
    assert away is not None
    assert (away.iteration, away.lost_in, away.by_simulation, away.score_rose) == (1, 2, True, False)
    assert away.error == pytest.approx(0.01)
    assert away.added_by_simulation == pytest.approx(0.29)
    assert away.added_by_refiner == pytest.approx(0.01)
    assert away.n_unstable == 1

    slid = iteration(1, ("current", 0.2, 0.5), ("refined", 0.3, 0.8))
    away = lost([slid], slid.best, error_of)
    assert away is not None
    assert (away.iteration, away.lost_in, away.by_simulation, away.score_rose) == (0, 1, False, True)

    assert lost([near], near.best, error_of) is None, "it ends where it was nearest"
    far = iteration(1, ("current", 0.4, 0.5), ("refined", 0.6, 0.8))
    assert lost([far], far.best, error_of) is None, "it was never near"
    edited = iteration(1, ("current", 0.05, 0.5), ("edited", 0.3, 0.4))
    assert lost([edited], edited.best, error_of) is None
    assert lost([slid], slid.best, lambda T_cam_obj: None) is None, "without ground truth nothing is known"
