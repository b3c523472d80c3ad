"""Numbers of groups against what the rows say, which is best, what is next, and two runs side by side."""

from __future__ import annotations

import itertools
import json
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.changing import replace
from tests.made_runs import answer, because
from tests.received import received
from tests.report.runs import row
from tests.report.sections import NO_ANSWER, WRONG, group, run, section_of
from verefine_viz.core.causes import Cause
from verefine_viz.core.geometry import transform
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.page.gallery_messages import BestGroup
from verefine_viz.report.bop_recalls import BopRecalls
from verefine_viz.report.group_numbers import (
    THRESHOLDS,
    GroupComparison,
    GroupLine,
    cause_counts,
    compare,
    hardest,
    object_numbers,
    score_misleads,
    stage_times,
)
from verefine_viz.report.groups import Group
from verefine_viz.report.pair_difference import SAME, apart, difference, wrong_in
from verefine_viz.report.report_words import NextStep, advice, counted, explanation, headline, next_step, title
from verefine_viz.run.record import Answer


def compared(*groups: Group) -> GroupComparison:
    return compare(section_of(*groups), BopRecalls())


def line(*rows: Answer, method: str = "rir") -> GroupLine:
    return compared(group(method, rows)).lines[0]


def frames(n: int, wrong: tuple[int, ...] = (), **values: Any) -> tuple[Answer, ...]:
    return tuple(row(k, **(values | (WRONG if k in wrong else {}))) for k in range(n))


def value(of: GroupLine, name: str) -> float | None:
    return of.numbers[name].value if name in of.numbers else None


def test_numbers_say_what_the_rows_do() -> None:
    rows = (row(1, 0), row(1, 1, **WRONG), row(2, 0, **NO_ANSWER), row(3, 0, add_s_mm=9.9, n_iterations=5))
    found = compared(group("rir", rows, rows[:2])).lines[0]
    errors = [2, 40, 9.9, 2, 40]
    assert value(found, "recall") == 3 / 6
    assert value(found, "mean_mm") == pytest.approx(np.mean(errors))
    assert value(found, "median_mm") == pytest.approx(np.median(errors))
    assert value(found, "calls") == pytest.approx(np.mean([25, 25, 5, 25, 25]))
    # Frames take 80, 40 and 40 ms, with another seed 80.
    assert value(found, "ms_per_frame") == 60.0
    assert "ar" not in found.numbers
    assert "lifted" not in found.numbers


def test_an_object_without_an_answer_is_missed_and_so_are_those_of_failed_frames() -> None:
    failed = row(9, 0, status="failed", add_s_mm=None, score=None, ms_total=0.0)
    left_out = row(1, 5, status="left_out", add_s_mm=None, score=None, ms_total=0.0)
    found = line(row(1), row(2, **NO_ANSWER), failed, left_out)
    assert value(found, "recall") == 1 / 4
    assert [r.frame for r in found.group.failures] == ["1/2"]
    unknown = answer(scene_id=1, im_id=9, status="failed", message="no depth")
    assert value(line(row(1), unknown), "recall") == 1.0
    assert line(unknown).numbers == {}


def test_right_as_far_as_the_image_shows_is_a_share_of_its_own_where_it_was_worked_out() -> None:
    known = row(1, right_seen=True), row(2, **WRONG, right_seen=True), row(3, **WRONG, right_seen=False)
    found = line(*known, row(4, **NO_ANSWER))
    assert (value(found, "recall"), value(found, "recall_seen")) == (1 / 4, 2 / 4)
    assert "recall_seen" not in line(row(1), row(2, **WRONG), row(3, **NO_ANSWER)).numbers


def test_without_ground_truth_there_are_scores_and_times_alone() -> None:
    found = compared(group("rir", frames(4, has_truth=False, add_s_mm=None, rotation_deg=None, translation_mm=None)))
    assert not found.has_truth
    assert set(found.lines[0].numbers) == {"score", "ms_per_frame", "calls"}
    assert found.lines[0].curve is None
    assert cause_counts(found.lines[0].group) == {}


def test_grasps_count_where_they_were_tried() -> None:
    ends = ("success", "success", "success", "slipped")
    found = line(*(row(k, grasp=end, grasp_ground_truth="success") for k, end in enumerate(ends)), row(9))
    assert value(found, "lifted") == 0.75


@given(st.lists(st.none() | st.floats(0, 100), min_size=1, max_size=20))
def test_the_curve_of_recall_is_the_share_below_each_limit(errors_mm: list[float | None]) -> None:
    found = line(*(row(k, **({"add_s_mm": e} if e is not None else NO_ANSWER)) for k, e in enumerate(errors_mm)))
    assert found.curve is not None
    recall, band = found.curve
    shares = np.array([np.inf if e is None else e / 100.0 for e in errors_mm])
    assert recall == pytest.approx([(shares < limit).mean() for limit in THRESHOLDS])
    if len(errors_mm) > 1:
        low, high = band
        assert (low <= high).all()
        assert (np.diff(low) >= 0).all()
        assert (np.diff(high) >= 0).all()


def test_the_best_group_has_most_right_then_the_least_error_and_the_others_are_measured_against_it() -> None:
    found = compared(group("pir", frames(20, tuple(range(10)))), group("rir", frames(20, (3,))))
    assert found.best.name == "rir"
    other, best = found.lines
    assert best.behind is None
    assert other.behind.value == pytest.approx(-0.45)
    assert other.behind.is_clear
    assert compared(group("pir", frames(5)), group("rir", frames(5, add_s_mm=1.0))).best.name == "rir"


def test_groups_are_compared_over_the_objects_of_both() -> None:
    found = compared(group("pir", frames(10, (1,))), group("rir", frames(5)))
    assert found.best.name == "rir"
    assert value(found.lines[0], "recall") == 0.9
    assert found.lines[0].behind.value == pytest.approx(-1 / 5)


def test_stages_are_those_of_a_frame_with_the_iterations_split_up() -> None:
    def timed(rows: tuple[Answer, ...], stages_ms: dict[str, float]) -> dict[str, float]:
        mine = group("rir", rows)
        totals = replace(mine.runs[0].run.totals, mean_stages_ms_per_frame=stages_ms)
        info = replace(mine.runs[0].run, totals=totals)
        return stage_times(Group("rir", (replace(mine.runs[0], run=info),)))

    rows = (row(1, 0), row(1, 1), row(2, 0), row(2, 1))
    found = timed(rows, {"record": 5.0, "read": 30.0, "iterate": 200.0, "prepare": 900.0})
    assert list(found) == ["read", "prepare", "refine", "simulate", "score", "rest", "record"]
    assert (found["refine"], found["simulate"], found["score"]) == (20.0, 10.0, 30.0)
    assert sum(found.values()) == pytest.approx(30 + 900 + 200 + 5)
    assert timed((answer(scene_id=1, im_id=9, status="failed", message="no depth"),), {"read": 1.0}) == {}


def test_objects_have_their_numbers_in_each_group_and_their_most_frequent_cause() -> None:
    pir = group(
        "pir", (row(1, 0, findings=because("pool"), **WRONG), row(2, 0, findings=because("score"), **WRONG), row(1, 1))
    )
    rir = group("rir", (row(1, 0), row(2, 0, findings=because("score"), **WRONG)))
    bop = BopRecalls({(pir.runs[0].folder, "1/1", 1): (1, 0.25), (pir.runs[0].folder, "1/2", 1): (3, 0.75)})
    found = compare(section_of(pir, rir), bop)
    first, second = object_numbers(found)
    assert (first.id, first.name) == (1, "object 1")
    assert [(cell.n, cell.right, cell.ar) for cell in first.cells] == [(2, 0.0, 62.5), (2, 50.0, None)]
    assert first.cells[1].cause == "score ranks a wrong pose above the ground truth"
    assert (first.cells[0].median_mm, first.cells[1].median_mm) == (40.0, 21.0)
    assert [None if cell is None else cell.right for cell in second.cells] == [100.0, None]
    assert found.lines[0].numbers["ar"].value == pytest.approx(0.625)


def test_hard_is_what_most_groups_get_wrong_with_most_seeds() -> None:
    always = row(1, 0, findings=because("pool"), **WRONG)
    sometimes = row(1, 1, **WRONG), row(1, 1), row(1, 1)
    groups = [
        group(name, *((always, other) if name != "rir" else (row(1, 0), other) for other in sometimes))
        for name in ("pir", "sir", "rir")
    ]
    rows = [one for named in groups for one in named.rows]
    (hard,) = hardest(section_of(*groups), {id(one): key for key, one in enumerate(rows)})
    assert (hard.frame, rows[hard.key].instance_id, hard.wrong_groups, hard.groups) == ("1/1", 0, 2, 3)
    assert (hard.best, hard.right, hard.n) == (BestGroup("rir", 3, 3), 3, 9)
    assert hard.cause == "no good hypothesis in the pool"


def test_a_score_misleads_as_often_as_a_wrong_answer_scores_above_a_right_one() -> None:
    scores = (0.9, 0.8, 0.5), (0.85, 0.1)
    right, wrong = scores
    rows = [row(k, score=s) for k, s in enumerate(right)] + [row(9 + k, score=s, **WRONG) for k, s in enumerate(wrong)]
    assert score_misleads(group("rir", tuple(rows))) == pytest.approx(
        np.mean([w > r for w in wrong for r in right]), abs=1e-4
    )
    assert score_misleads(group("rir", (row(1),))) is None


def test_the_best_is_claimed_only_where_it_is_clear() -> None:
    def said(*groups: Group) -> str:
        return headline(compared(*groups))

    best = said(group("pir", frames(20, tuple(range(10)))), group("rir", frames(20, (3,))))
    assert best.startswith("rir gets 95.0 %")
    assert "the best, 45.0 points more than pir" in best
    close = group("pir", frames(20, (1, 2))), group("rir", frames(20, (3,))), group("sir", frames(20, (*range(15),)))
    for words in ("None is clearly best", "pir within the noise", "behind: sir"):
        assert words in said(*close)
    for unclear in (
        (group("rir", frames(5, (1,))), group("sir", frames(5, (1,)))),
        (group("pir", frames(1, (0,))), group("rir", frames(1))),
        [group(name, frames(4, has_truth=False, add_s_mm=None)) for name in ("sir", "rir")],
    ):
        assert "the best, " not in said(*unclear)
    failed = answer(scene_id=1, im_id=9, status="failed", message="no depth")
    alone = said(group("rir", (row(1), row(2, **NO_ANSWER), row(3, **WRONG), failed)))
    for count in ("1 of 3 right", "4 frames", "1 has no answer", "1 frame failed"):
        assert count in alone
    seen = said(group("rir", (row(1), row(2, **WRONG, right_seen=True), row(3, **WRONG, right_seen=False))))
    assert "1 of 3 right, 2 as far" in seen


def test_a_report_and_its_intervals_name_how_many_there_are() -> None:
    rir, pir = group("rir", frames(2), frames(2)), group("pir", frames(2))
    assert title([section_of(rir)]) == "rir on some data, 2 seeds"
    assert title([section_of(rir), section_of(pir)]) == "3 runs on 2 sets of data"
    assert counted([section_of(rir, pir)]) == "2 groups, 3 runs, 2 frames"
    rows = (*frames(3), row(1, 1))
    assert "3 frames and 2 objects, each with all its seeds" in explanation(compared(group("rir", rows, rows)))
    assert explanation(compared(group("rir", frames(1)))) == ""


def step(*causes: str, **values: Any) -> NextStep | None:
    """Of a run with four right answers, whose wrong ones, the worst first, have these causes."""
    known = (
        {"im_id": k, "add_s_mm": 90.0 - k, "name": f"box {k}", "findings": because(cause)}
        for k, cause in enumerate(causes)
    )
    wrong = [row(**(mine | values)) for mine in known]
    return next_step(group("rir", (*(row(90 + k) for k in range(4)), *reversed(wrong))))


@pytest.mark.parametrize(
    ("causes", "values", "frame", "counted"),
    [
        # The most frequent cause leads, and its worst answer comes first.
        (("pool", *["arm_starved"] * 2, "pool", *["arm_starved"] * 2), {}, "1/1", ("4 of 6", "tried too little")),
        (("pool", "arm_starved", "pool", "arm_starved", "mask"), {}, "1/0", ("among 5", "pool 2", "mask")),
        (("", ""), {}, "1/0", ("2 wrong answers",)),
        (("pool", "", "pool", "", "pool"), {}, "1/0", ("2 not explained",)),
        (("moon_phase",), {}, "1/0", ("of 5", "moon phase")),
        (("pool", "pool", "mask"), {}, "1/0", ("few cases",)),
        # What all have in common.
        (("pool", "pool", "pool"), {"name": "bowl"}, "1/0", (", all of them of the bowl",)),
        (("pool", "pool", "pool"), {"im_id": 7}, "1/7", (", all in frame 1/7",)),
    ],
)
def test_the_next_step_is_about_the_most_frequent_cause(
    causes: tuple[str, ...], values: dict[str, Any], frame: str, counted: tuple[str, ...]
) -> None:
    found = step(*causes, **values)
    assert found is not None
    assert found.begin.frame == frame
    assert all(words in found.text for words in counted), found.text


def test_without_wrong_answers_there_is_no_next_step_and_without_ground_truth_it_is_the_lowest_score() -> None:
    assert step() is None
    several = step("pool", "pool", "pool", "pool", "mask")
    assert several is not None
    assert not any(words in several.text for words in (", all", "few cases", "not explained"))
    rows = tuple(row(k, has_truth=False, add_s_mm=None, score=score) for k, score in ((1, 0.9), (2, 0.1)))
    found = next_step(group("rir", rows))
    assert found is not None
    assert found.begin.im_id == 2


def test_every_cause_has_advice_that_fits_the_method() -> None:
    for cause, method in itertools.product(Cause, ALL_METHOD_NAMES):
        words = advice(cause, method)
        is_of_the_tree = method == "physim_mcts" and cause in (Cause.ARM_STARVED, Cause.BUDGET)
        assert ("mcts." in words) == is_of_the_tree, (cause, method)
        # Only these weigh exploration against what they know.
        assert "method.exploration" not in words or method in ("rir", "vf_breadth", "vf_depth"), (cause, method)


# Two runs side by side


def pair(a: list[Answer], b: list[Answer]) -> tuple[Group, Group, dict[int, int]]:
    keys = {id(one): key for key, one in enumerate((*a, *b))}
    return Group("A", (run("a", *a),)), Group("B", (run("b", *b),)), keys


def test_objects_that_changed_and_what_they_became() -> None:
    a = [row(1, 0, **WRONG), row(1, 1), row(2, 0, **NO_ANSWER), row(2, 1), row(3, 0), row(4, 0)]
    b = [row(1, 0), row(1, 1, add_s_mm=2.1), row(2, 0), row(2, 1, **WRONG), row(3, 0, **NO_ANSWER), row(5, 0)]
    changed = difference(*pair(a, b))
    found = received(changed)
    assert [(o["frame"], o["turned"], o["errors"], o["by"]) for o in found["objects"]] == [
        ("1/2", "right", [None, 2.0], None),
        ("1/1", "right", [40.0, 2.0], -38.0),
        ("1/1", "", [2.0, 2.1], 0.1),
        ("1/2", "wrong", [2.0, 40.0], 38.0),
        ("1/3", "wrong", [2.0, None], None),
    ]
    assert [found[name] for name in ("n", "better", "worse", "now_right", "now_wrong", "both_wrong")] == [
        5, 2, 2, 2, 2, 0
    ]  # fmt: skip
    assert found["only"] == [1, 1]
    assert found["objects"][0]["keys"] == [2, 8]
    assert {f["frame"]: (f["errors"], f["right"]) for f in found["frames"]} == {
        "1/1": ([21.0, 2.05], [1, 2]),
        "1/2": ([2.0, 40.0], [1, 1]),
        "1/3": ([None, None], [1, 0]),
    }
    json.dumps(msgspec.to_builtins(changed), allow_nan=False)


@given(st.lists(st.tuples(st.none() | st.floats(0, 90), st.none() | st.floats(0, 90)), max_size=12))
def test_turned_round_better_is_worse(errors: list[tuple[float | None, float | None]]) -> None:
    def rows(side: int) -> list[Answer]:
        values = [pair[side] for pair in errors]
        return [row(k, **({"add_s_mm": e} if e is not None else NO_ANSWER)) for k, e in enumerate(values)]

    there, back = (difference(*pair(rows(one), rows(1 - one))) for one in (0, 1))
    assert (there.better, there.worse) == (back.worse, back.better)
    assert (there.now_right, there.now_wrong) == (back.now_wrong, back.now_right)
    assert there.both_wrong == back.both_wrong
    assert there.n == len(errors)
    # Listed rounded: 0.5 % may be a little more.
    unchanged = sum(o.by is not None and abs(o.by) < 100 * SAME for o in there.objects)
    both_missing = sum(o.errors == (None, None) for o in there.objects)
    assert there.better + there.worse + max(unchanged, both_missing) <= there.n


def test_without_ground_truth_none_is_wrong_and_how_far_answers_are_apart_is_listed() -> None:
    unknown = {"has_truth": False, "add_s_mm": None}
    shifts = {1: 0.0, 2: 0.03, 3: 0.01}
    a, b, keys = pair(
        [row(k, T_cam_obj=np.eye(4), **unknown) for k in shifts],
        [row(k, T_cam_obj=transform(np.eye(3), [shift, 0, 0]), **unknown) for k, shift in shifts.items()],
    )
    assert wrong_in(a, b) == {}
    assert [(one.frame, one.mm, one.deg) for one in apart(a, b, keys)] == [
        ("1/2", 30.0, 0.0), ("1/3", 10.0, 0.0), ("1/1", 0.0, 0.0)
    ]  # fmt: skip


def test_an_object_is_wrong_in_one_run_or_in_both() -> None:
    a, b, _ = pair(
        [row(1, 0, **WRONG), row(2, 0), row(3, 0, **NO_ANSWER), row(4, 0), row(5, 0, **WRONG)],
        [row(1, 0), row(2, 0, **WRONG), row(3, 0, **WRONG), row(4, 0)],
    )
    words = wrong_in(a, b)
    assert [words.get(id(one), "") for one in a.objects] == [
        "only A wrong",
        "only B wrong",
        "both wrong",
        "",
        "only A wrong",
    ]
    assert [words.get(id(one), "") for one in b.objects] == ["only A wrong", "only B wrong", "both wrong", ""]
