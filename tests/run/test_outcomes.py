"""Who came nearer of two runs, and what each has cost."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from tests.run.comparing import METHODS, trace
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.run.outcomes import effort_of, outcomes


def errors_of(target: Any, T: Any) -> Any:
    return pose_errors(target.model, T, target.instance.T_cam_obj_gt)


def test_swapping_the_sides_swaps_the_winners() -> None:
    a = trace("rir", 2)
    swapped = {"A": "B", "B": "A", "even": "even"}
    for other in METHODS:
        b = trace(other, 2)
        one, back = outcomes(a, b, errors_of), outcomes(b, a, errors_of)
        assert [swapped[o.winner] for o in one if o.winner] == [o.winner for o in back], other
        for o in one:
            nearer = "A" if o.a.errors.add_s_mm < o.b.errors.add_s_mm else "B"
            assert o.winner in (nearer, "even")


def test_without_ground_truth_the_score_decides_by_the_rule_of_one_side() -> None:
    a, b = trace("rir"), trace("refine")
    plain = outcomes(a, b, lambda target, T: None)
    assert plain[0].winner == "A"
    judged = outcomes(a, b, lambda target, T: None, lambda target, best: 1.0)
    assert judged[0].winner == "B"
    assert judged[0].a.score == plain[0].a.score  # type: ignore[union-attr]


def test_an_object_without_an_answer_has_no_winner() -> None:
    a = trace("rir", 2)
    found = outcomes(a, replace(a, problem=a.problem.only([0]), answers=({},)), errors_of)
    assert [o.winner for o in found] == [None, None]


def test_effort_counts_refiner_calls() -> None:
    assert effort_of(trace("rir", 2)).refiner_calls == 2 * 3 * 2
    assert effort_of(trace("sir", 2)).refiner_calls == 2 * 2
    effort = effort_of(trace("refine"))
    assert (effort.iterations, effort.planned, effort.rollout_calls) == (2, 2, 0)
