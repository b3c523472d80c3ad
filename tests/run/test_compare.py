"""Laws of comparing two runs: what is the same is told as the same, and nothing of either run is left out."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.changing import replace
from tests.run.comparing import METHODS, made_up, run_of, trace
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.core.records import Iteration
from verefine_viz.run.compare import (
    Difference,
    Trace,
    aligned,
    apart,
    differences,
    first_difference,
    keys_of,
    refiner_calls,
    trace_of,
)

ORDERS = st.lists(st.tuples(st.integers(0, 2), st.booleans()), max_size=14)


def between(a: Trace, b: Trace) -> Difference | None:
    return first_difference(a, b, aligned(a, b))


@settings(max_examples=60)
@given(ORDERS, ORDERS)
def test_the_timeline_holds_every_iteration_of_both_once_and_never_goes_back(one: Any, other: Any) -> None:
    a, b = made_up(one), made_up(other)
    timeline = aligned(a, b)
    assert sorted(m.a for m in timeline.moments if m.a) == list(range(1, len(one) + 1))
    assert sorted(m.b for m in timeline.moments if m.b) == list(range(1, len(other) + 1))
    assert [m.a for m in timeline.moments if m.a] == list(range(1, len(one) + 1)), "A's own order is kept"
    for own in range(3):
        mine = [m for m in timeline.moments if m.instance_id == own]
        assert [m.b for m in mine if m.b] == sorted(m.b for m in mine if m.b)
        assert [m.calls for m in mine] == sorted(m.calls for m in mine)


@settings(max_examples=60)
@given(ORDERS, ORDERS)
def test_what_stands_beside_each_other_has_cost_the_same(one: Any, other: Any) -> None:
    a, b = made_up(one), made_up(other)
    timeline = aligned(a, b)
    for moment in timeline.moments:
        for index, side in ((moment.a, a), (moment.b, b)):
            if index is None:
                continue
            until = [i for i in side.iterations[:index] if i.instance_id == moment.instance_id]
            assert sum(map(refiner_calls, until)) == moment.calls
            assert until[-1].index == index
    for place in range(len(timeline) + 1):
        for own in range(3):
            at_a, at_b = timeline.latest(place, own)
            calls_a = sum(map(refiner_calls, [i for i in a.own[own] if i.index <= at_a]))
            calls_b = sum(map(refiner_calls, [i for i in b.own[own] if i.index <= at_b]))
            last = max((m.calls for m in timeline.moments[:place] if m.instance_id == own), default=0)
            assert max(calls_a, calls_b) == last


@settings(max_examples=40)
@given(ORDERS)
def test_runs_of_one_structure_are_beside_each_other_iteration_by_iteration(order: Any) -> None:
    timeline = aligned(made_up(order), made_up(order))
    assert [(m.a, m.b) for m in timeline.moments] == [(k, k) for k in range(1, len(order) + 1)]


@settings(max_examples=40)
@given(ORDERS, st.integers(0, 14))
def test_a_moment_keeps_its_place_by_name_while_a_run_grows(order: Any, n: int) -> None:
    whole, part = made_up(order), made_up(order[:n], n_planned=len(order))
    assert keys_of(part.iterations) == keys_of(whole.iterations)[: len(part.iterations)]
    grown = aligned(whole, whole)
    for k, moment in enumerate(aligned(whole, part).moments, 1):
        assert grown.place(moment.key) == k


def test_one_after_another_and_in_turns_are_compared_object_by_object() -> None:
    one_by_one = made_up([(0, True)] * 3 + [(1, True)] * 3)
    in_turns = made_up([(0, True), (1, True)] * 4)
    moments = aligned(one_by_one, in_turns).moments
    assert [(m.instance_id, m.calls, m.a, m.b) for m in moments] == [
        (0, 1, 1, 1), (0, 2, 2, 3), (0, 3, 3, 5), (1, 1, 4, 2), (1, 2, 5, 4), (1, 3, 6, 6),
        (0, 4, None, 7), (1, 4, None, 8),
    ]  # fmt: skip


def test_a_longer_run_goes_on_where_the_shorter_one_has_left_the_object() -> None:
    short = made_up([(0, True), (1, True)])
    long = made_up([(0, True)] * 3 + [(1, True)] * 2)
    moments = aligned(short, long).moments
    assert [(m.instance_id, m.a, m.b) for m in moments] == [
        (0, 1, 1), (0, None, 2), (0, None, 3), (1, 2, 4), (1, None, 5)
    ]  # fmt: skip


def brute_force(a: Trace, b: Trace) -> tuple[int, str] | None:
    """The first place at which any number that tells is another, looked at one by one."""
    for own in a.instance_ids:
        ours, theirs = a.problem.target(own).instance, b.problem.target(own).instance
        poses = [[h.T_cam_obj.tolist() for h in i.hypotheses] for i in (ours, theirs)]
        if poses[0] != poses[1] or tuple(a.initial[own]) != tuple(b.initial[own]):
            return 0, "start"
    for place, m in enumerate(aligned(a, b).moments, 1):
        if m.a is None or m.b is None:
            if (m.b is None and b.is_done) or (m.a is None and a.is_done):
                return place, "missing"
            continue
        if told(a.iterations[m.a - 1]) != told(b.iterations[m.b - 1]):
            return place, "told"
    return None


def told(i: Iteration) -> Any:
    return (
        i.arm,
        [(p.instance_id, p.T_cam_obj.tolist()) for p in i.placed],
        [(s.name, s.T_cam_obj.tolist(), s.score.score if s.score else None) for s in i.stages],
        i.accepted,
        i.best.T_cam_obj.tolist(),
    )


def test_the_first_difference_is_the_one_that_looking_at_everything_finds() -> None:
    ours, theirs = ({name: trace(name, 2) for name in METHODS} for _ in range(2))
    for (one, a), (other, b) in product(ours.items(), theirs.items()):
        found, expected = between(a, b), brute_force(a, b)
        assert (found.place if found else None) == (expected[0] if expected else None), (one, other)
        assert found is None or one != other, one


@settings(max_examples=40)
@given(st.integers(0, 11), st.sampled_from(["pose", "score", "arm", "accepted"]), st.data())
def test_one_thing_changed_anywhere_is_found_there(k: int, what: str, data: st.DataObject) -> None:
    a = trace("rir", 2)
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
    b = replace(a, iterations=(*a.iterations[:k], changed, *a.iterations[k + 1 :]))
    found = between(a, b)
    assert (found.place, found.a, found.b, found.instance_id) == (k + 1, k + 1, k + 1, record.instance_id)
    assert found.kind == {"arm": "hypothesis"}.get(what, what)
    if what == "pose":
        assert found.text == f"has its {stage.name} pose of box #{record.instance_id} 3.2 mm and 0.0° away"
    back = between(b, a)
    assert (back.place, back.kind) == (found.place, found.kind), "swapping the sides moves nothing"


def test_sentences_have_numbers_and_units() -> None:
    T = transform(axis_angle(np.array([0, 0, 1.0]), np.deg2rad(1.1)), [0.0032, 0, 0])
    assert apart(np.eye(4), T) == "3.2 mm and 1.1°"
    assert apart(np.eye(4), transform(np.eye(3), [2e-5, 0, 0])) == "0.020 mm and 0.000°"
    assert apart(np.eye(4), transform(np.eye(3), [1e-9, 0, 0])) == "less than 0.001 mm and 0.001°"
    found = between(trace("sir"), trace("refine"))
    assert found.text == "goes through current, refined with box instead of current, simulated, mixed, refined"


def test_scores_and_deeds_are_reported_apart() -> None:
    a = trace("rir")
    start = {own: tuple(f + 0.01 for f in scores) for own, scores in a.initial.items()}
    b = replace(a, initial=start)
    found = differences(a, b, aligned(a, b))
    assert found.deed is None
    assert found.score.text.startswith("scores the initial pose of box's hypothesis 1 0.")
    assert found.first == found.score


def test_what_is_not_made_yet_is_no_difference_but_a_missing_call_is() -> None:
    a, b = run_of("rir"), run_of("rir")
    a.finish()
    b.step()
    assert between(trace_of(a), trace_of(b)) is None
    assert not trace_of(b).is_done
    found = between(trace("sir"), trace("sir", iterations=3))
    assert (found.place, found.kind, found.text) == (3, "missing", "goes on with refiner call 3 on box, A does not")
    found = between(trace("sir", iterations=3), trace("sir"))
    assert found.text == "has no refiner call 3 on box, A goes on"


def test_other_objects_and_other_initial_poses_are_reported_before_the_first_iteration() -> None:
    a, b = trace("sir", 2), trace("sir", 1)
    found = between(a, b)
    assert (found.place, found.text) == (0, "starts hypothesis 1 of box #0 90.0 mm and 0.0° away")
    only = replace(a, problem=a.problem.only([0]))
    found = between(a, only)
    assert (found.place, found.kind, found.text) == (0, "start", "does not solve box #1")
    found = between(only, a)
    assert found.text == "also solves box #1"
