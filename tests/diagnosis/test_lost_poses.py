"""Near poses that a run had, and what led it away from them."""

from __future__ import annotations

import numpy as np
import pytest

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import transform
from verefine_viz.core.records import Best, Event, Iteration, Stage, StageName
from verefine_viz.core.scores import PoseScore
from verefine_viz.diagnosis.lost_poses import lost


def score(value: float) -> PoseScore:
    return PoseScore(value, value, value, 100, 100, (100, 0, 0, 0, 0))


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
