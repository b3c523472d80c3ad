"""Laws of comparing two runs: nothing of either is left out, what is the same is no difference, and who came nearer."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.changing import replace
from tests.run.comparing import METHODS, altered, finished, made_up, run_of
from verefine_viz.core.geometry import transform
from verefine_viz.core.records import Iteration
from verefine_viz.evaluation.pose_errors import pose_errors
from verefine_viz.run.compare import Departure, Pair, aligned, departures, effort_of, outcomes
from verefine_viz.run.engine import Run

ORDERS = st.lists(st.integers(0, 2), max_size=14)


def pairs_of(a: Run, b: Run) -> tuple[Pair, ...]:
    return aligned(a.iterations, b.iterations)


def between(a: Run, b: Run) -> Departure | None:
    """The first difference of any kind."""
    deed, score = departures(a, b, pairs_of(a, b))
    return min(filter(None, (deed, score)), key=lambda d: d.place, default=None)


# Which iterations stand beside each other.


@settings(max_examples=60)
@given(ORDERS, ORDERS)
def test_every_iteration_of_both_is_in_one_pair_and_keeps_its_order(one: list[int], other: list[int]) -> None:
    pairs = pairs_of(made_up(one), made_up(other))
    assert [p.a for p in pairs if p.a] == list(range(1, len(one) + 1)), "A's own order is kept"
    assert sorted(p.b for p in pairs if p.b) == list(range(1, len(other) + 1))
    for own in range(3):
        mine = [p for p in pairs if p.instance_id == own]
        assert [p.n for p in mine] == list(range(1, max(one.count(own), other.count(own)) + 1))
        for order, indices in ((one, [p.a for p in mine if p.a]), (other, [p.b for p in mine if p.b])):
            assert indices == [k for k, i in enumerate(order, 1) if i == own]
        n_both = min(one.count(own), other.count(own))
        assert all(p.a and p.b for p in mine[:n_both]), "the n-th stands beside the n-th"


@settings(max_examples=40)
@given(ORDERS)
def test_equal_runs_are_beside_each_other_iteration_by_iteration(order: list[int]) -> None:
    a, b = made_up(order), made_up(order)
    assert [(p.a, p.b) for p in pairs_of(a, b)] == [(k, k) for k in range(1, len(order) + 1)]
    assert departures(a, b, pairs_of(a, b)) == (None, None)


@settings(max_examples=40)
@given(ORDERS, ORDERS, st.integers(0, 14))
def test_swapping_the_sides_or_a_run_that_grows_changes_no_pair(one: list[int], other: list[int], n: int) -> None:
    a, b = made_up(one), made_up(other)
    assert {(p.instance_id, p.n, p.b, p.a) for p in pairs_of(b, a)} == set(pairs_of(a, b))
    whole = {p[:2]: p.b for p in pairs_of(a, b)}
    for p in pairs_of(a, made_up(other[:n])):
        assert p.b in (whole[p[:2]], None)


# The first differences.


def test_what_only_b_has_follows_the_last_of_a_on_that_object() -> None:
    in_turns = made_up([0, 1] * 4)
    assert pairs_of(made_up([0] * 3 + [1] * 3), in_turns) == (
        (0, 1, 1, 1), (0, 2, 2, 3), (0, 3, 3, 5), (0, 4, None, 7),
        (1, 1, 4, 2), (1, 2, 5, 4), (1, 3, 6, 6), (1, 4, None, 8),
    )  # fmt: skip
    assert pairs_of(made_up([2]), in_turns)[:3] == ((2, 1, 1, None), (0, 1, None, 1), (1, 1, None, 2))


def brute_force(a: Run, b: Run) -> int | None:
    """The first pair in which any number is another, compared one by one."""
    for ours, theirs, f_a, f_b in zip(
        a.problem.instances, b.problem.instances, a.state_at(0).initial, b.state_at(0).initial, strict=True
    ):
        poses = [[h.T_cam_obj.tolist() for h in i.hypotheses] for i in (ours, theirs)]
        if poses[0] != poses[1] or f_a.score.tolist() != f_b.score.tolist():
            return 0
    for place, p in enumerate(pairs_of(a, b), 1):
        if p.a is None or p.b is None:
            if (p.b is None and b.is_done) or (p.a is None and a.is_done):
                return place
            continue
        if numbers(a.iterations[p.a - 1]) != numbers(b.iterations[p.b - 1]):
            return place
    return None


def numbers(i: Iteration) -> Any:
    return (
        i.arm,
        [(p.instance_id, p.T_cam_obj.tolist()) for p in i.placed],
        [(s.name, s.T_cam_obj.tolist(), s.score.score if s.score else None) for s in i.stages],
        i.accepted,
        i.best.T_cam_obj.tolist(),
    )


def test_the_first_difference_is_the_one_that_comparing_everything_gives() -> None:
    ours, theirs = ({name: finished(name, 2) for name in METHODS} for _ in range(2))
    for (one, a), (other, b) in product(ours.items(), theirs.items()):
        first = between(a, b)
        assert (first.place if first else None) == brute_force(a, b), (one, other)
        assert first is None or one != other, one


@settings(max_examples=40)
@given(st.integers(0, 11), st.sampled_from(["pose", "score", "arm", "accepted"]), st.data())
def test_one_thing_changed_anywhere_is_found_there(k: int, what: str, data: st.DataObject) -> None:
    a = finished("rir", 2)
    record = a.iterations[k]
    n = data.draw(st.integers(0, len(record.stages) - 1))
    stage = record.stages[n]
    if what == "pose":
        stage = replace(stage, T_cam_obj=stage.T_cam_obj @ transform(np.eye(3), [0.0032, 0, 0]))
    elif what == "score":
        if stage.score is None:
            return
        stage = replace(stage, score=replace(stage.score, score=stage.score.score + 1e-9))
    stages = (*record.stages[:n], stage, *record.stages[n + 1 :])
    changed = replace(record, stages=stages)
    if what == "arm":
        changed = replace(changed, arm=record.arm + 1)
    if what == "accepted":
        changed = replace(changed, accepted="mixed")
    b = altered(a, (*a.iterations[:k], changed, *a.iterations[k + 1 :]))
    first = between(a, b)
    assert (first.place, first.a, first.b) == (k + 1, k + 1, k + 1)
    assert first.kind == {"arm": "hypothesis"}.get(what, what)
    if what == "pose":
        assert first.text == f"has its {stage.name} pose of box #{record.instance_id} 3.2 mm and 0.0° away"
    back = between(b, a)
    assert (back.place, back.kind) == (first.place, first.kind), "swapping the sides moves nothing"


def test_scores_and_deeds_are_reported_apart() -> None:
    a = finished("rir")
    (scores,) = a.state_at(0).initial
    b = altered(a, initial=(replace(scores, score=scores.score + 0.01),))
    deed, score = departures(a, b, pairs_of(a, b))
    assert deed is None
    assert score.text.startswith("scores the initial pose of box's hypothesis 1 0.")


def test_what_is_not_made_yet_is_no_difference_but_what_is_never_made_is() -> None:
    a, b = finished("rir"), run_of("rir")
    b.step()
    assert between(a, b) is None
    short, long = finished("sir"), finished("sir", iterations=3)
    first = between(short, long)
    assert (first.place, first.kind) == (3, "missing")
    assert first.text == "goes on with box, which A is done with after 2 iterations"
    assert between(long, short).text == "is done with box after 2 iterations, while A goes on"


def test_other_objects_and_other_initial_poses_are_reported_before_the_first_iteration() -> None:
    a, b = finished("sir", 2), finished("sir", 1)
    first = between(a, b)
    assert (first.place, first.text) == (0, "starts hypothesis 1 of box #0 90.0 mm and 0.0° away")
    state = a.state_at(0)
    only = altered(a, a.iterations_of(0), problem=a.problem.only([0]), initial=state.initial[:1], best=state.best[:1])
    first = between(a, only)
    assert (first.place, first.kind, first.text) == (0, "start", "does not solve box #1")
    assert between(only, a).text == "also solves box #1"


# Which came nearer, and at what cost.


def errors_of(target: Any, T: Any) -> Any:
    return pose_errors(target.model, T, target.instance.T_cam_obj_gt)


def test_swapping_the_sides_swaps_the_winners() -> None:
    a = finished("rir", 2)
    swapped = {"A": "B", "B": "A", "even": "even"}
    for other in METHODS:
        b = finished(other, 2)
        one, back = outcomes(a, b, errors_of), outcomes(b, a, errors_of)
        assert [swapped[o.winner] for o in one if o.winner] == [o.winner for o in back], other
        for o in one:
            nearer = "A" if o.a.errors.add_s_mm < o.b.errors.add_s_mm else "B"
            assert o.winner in (nearer, "even")


def test_without_ground_truth_the_score_decides_by_the_rule_of_one_side() -> None:
    a, b = finished("rir"), finished("refine")
    plain = outcomes(a, b, lambda target, T: None)
    assert plain[0].winner == "A"
    rescored = outcomes(a, b, lambda target, T: None, lambda target, best: 1.0)
    assert rescored[0].winner == "B"
    assert rescored[0].a.score == plain[0].a.score  # type: ignore[union-attr]


def test_an_object_without_an_answer_has_no_winner() -> None:
    a = finished("rir", 2)
    none = altered(a, (), problem=a.problem.only([0]), initial=(None,), best=(None,))
    assert [o.winner for o in outcomes(a, none, errors_of)] == [None, None]


def test_effort_counts_refiner_calls() -> None:
    assert effort_of(finished("rir", 2)).refiner_calls == 2 * 3 * 2
    assert effort_of(finished("sir", 2)).refiner_calls == 2 * 2
    effort = effort_of(finished("refine"))
    assert (effort.iterations, effort.planned, effort.rollout_calls) == (2, 2, 0)
