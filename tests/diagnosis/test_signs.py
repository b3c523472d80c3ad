"""Signs of a fault that need no re-run."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.core.records import Best, Event, Iteration, Stage, StageName
from verefine_viz.core.scores import PoseScore
from verefine_viz.diagnosis.signs import Course, far_start, is_low, leaks, lost, prefers, starved
from verefine_viz.evaluation.pose_errors import PoseErrors


def errors(relative: float) -> PoseErrors:
    """Of an object of 100 mm."""
    mm = 100 * relative
    return PoseErrors(0.0, mm, mm, mm, mm, relative)


def score(value: float, missed: int = 0) -> PoseScore:
    return PoseScore(value, value, value, 100, 100, (100 - missed, missed, 0, 0, 0))


def course(n_tried: tuple[int, ...] = (9, 1), answer: float = 0.5, at_gt: float = 0.9) -> Course:
    """The second hypothesis starts nearest, and the answer scores 0.8."""
    return Course((errors(0.6), errors(0.2)), n_tried, errors(answer), score(0.8), score(at_gt))


def test_the_nearest_start_is_far_from_a_quarter_of_the_diameter_on() -> None:
    assert far_start(course()) is None
    assert far_start(Course((errors(0.6), None, errors(0.3)), (1, 1, 1), None, None, None)) == (2, errors(0.3))
    assert far_start(Course((None,), (1,), None, None, None)) is None


@pytest.mark.parametrize(
    ("case", "is_starved"),
    [
        (course(), True),
        (course(n_tried=(8, 2)), False),
        (course(n_tried=(17, 3)), True),
        (course(answer=0.05), False),
        (course(at_gt=0.8), False),
        (Course((errors(0.2),), (9,), errors(0.5), None, None), False),
    ],
)
def test_a_near_start_with_next_to_no_iterations_is_starved_if_the_answer_is_wrong(
    case: Course, is_starved: bool
) -> None:
    assert starved(case) == ((1, errors(0.2)) if is_starved else None)


def test_signs_of_a_score() -> None:
    assert prefers(score(0.8), score(0.8))
    assert not prefers(score(0.7), score(0.8))
    assert [leaks(score(0.8, missed)) for missed in (24, 25)] == [False, True]
    assert [is_low(score(value)) for value in (0.44, 0.45)] == [True, False]


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
