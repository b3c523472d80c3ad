"""What a report says: no more than the numbers and causes support."""

from __future__ import annotations

import itertools
from typing import Any

from tests.made_runs import answer, because
from tests.report.runs import row
from tests.report.sections import NO_ANSWER, WRONG, group, section_of
from verefine_viz.core.causes import Cause
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES
from verefine_viz.report.bop_recalls import BopRecalls
from verefine_viz.report.group_numbers import compare
from verefine_viz.report.groups import Group
from verefine_viz.report.report_words import NextStep, advice, counted, explanation, headline, next_step, title
from verefine_viz.run.record import Answer


def frames(n: int, wrong: tuple[int, ...] = (), **values: Any) -> tuple[Answer, ...]:
    return tuple(row(k, **(values | (WRONG if k in wrong else {}))) for k in range(n))


def said_of(*groups: Group) -> str:
    return headline(compare(section_of(*groups), BopRecalls()))


def test_the_headline_counts_and_claims_no_more_than_the_numbers_support() -> None:
    failed = answer(scene_id=1, im_id=9, status="failed", message="no depth")
    one = said_of(group("rir", (row(1), row(2, **NO_ANSWER), row(3, **WRONG), failed)))
    assert one == "1 of 3 right in 4 frames; 1 has no answer; 1 frame failed."
    seen = said_of(group("rir", (row(1), row(2, **WRONG, right_seen=True), row(3, **WRONG, right_seen=False))))
    assert seen.startswith("1 of 3 right, 2 as far as the image shows")
    best = said_of(group("pir", frames(20, tuple(range(10)))), group("rir", frames(20, (3,))))
    assert ": the best, 45.0 points more than pir (95 %: " in best
    close = group("pir", frames(20, (1, 2))), group("rir", frames(20, (3,))), group("sir", frames(20, (*range(15),)))
    assert said_of(*close).startswith("None is clearly best. ")
    assert said_of(*close).endswith("; pir within the noise. Clearly behind: sir.")
    tie = said_of(group("rir", frames(5, (1,))), group("sir", frames(5, (1,))))
    assert tie == "Both get the same share of the objects right: 80.0 %."
    alone = said_of(group("pir", frames(1, (0,))), group("rir", frames(1)))
    assert "says nothing about how certain that is" in alone
    blind = frames(4, has_truth=False, add_s_mm=None)
    assert "it is unknown which is best" in said_of(group("sir", blind), group("rir", blind))


def test_intervals_say_what_was_drawn_and_that_seeds_were_not() -> None:
    rows = (*frames(3), row(1, 1))
    found = explanation(compare(section_of(group("rir", rows, rows)), BopRecalls()))
    assert "bootstrap over 3 frames and 2 objects, each with all its seeds" in found
    assert "seeds" not in explanation(compare(section_of(group("rir", rows)), BopRecalls()))
    assert explanation(compare(section_of(group("rir", frames(1))), BopRecalls())) == ""


def test_a_report_is_called_by_what_it_is_about() -> None:
    rir, pir = group("rir", frames(2), frames(2)), group("pir", frames(2))
    assert title([section_of(rir)]) == "rir on some data, 2 seeds"
    assert title([section_of(group("rir", frames(1)), pir)]) == "rir against pir on some data"
    assert title([section_of(rir), section_of(pir)]) == "3 runs on 2 sets of data"
    assert counted([section_of(rir, pir)]) == "2 groups, 3 runs, 2 frames"


def step(*causes: str, n_right: int = 4, **values: Any) -> NextStep | None:
    """Of a run whose wrong answers, the worst first, have these causes."""
    known = (
        {"im_id": k, "add_s_mm": 90.0 - k, "name": f"box {k}", "findings": because(cause)}
        for k, cause in enumerate(causes)
    )
    wrong = [row(**(mine | values)) for mine in known]
    return next_step(group("rir", (*(row(90 + k) for k in range(n_right)), *reversed(wrong))))


def said(*causes: str, **values: Any) -> str:
    found = step(*causes, **values)
    assert found is not None
    return found.text


def test_the_most_frequent_cause_leads_and_its_worst_answer_comes_first() -> None:
    found = step("pool", "arm_starved", "pool", "arm_starved", "arm_starved", "pool", "arm_starved")
    assert found is not None
    assert found.text.startswith("4 of 7 wrong answers have the cause “best hypothesis tried too little” (next: no ")
    assert found.begin.frame == "1/1"
    tie = step("pool", "arm_starved", "pool", "arm_starved", "mask")
    assert tie is not None
    assert tie.text.startswith("No cause stands out among 5 wrong answers")
    assert tie.begin.frame == "1/0"


def test_few_cases_unknown_causes_and_what_they_have_in_common_are_named() -> None:
    assert "few cases" in said("pool", "pool", "mask")
    assert "few cases" not in said(*["pool"] * 4, "mask")
    assert "2 not explained" in said("pool", "", "pool", "", "pool")
    assert said("", "").startswith("No cause is known for 2 wrong answers; begin with the worst,")
    assert said("moon_phase").startswith("The only wrong answer of 5 has the cause “moon phase”: look at ")
    assert ", all of them of the bowl: " in said("pool", "pool", "pool", name="bowl")
    assert ", all in frame 1/7: " in said("pool", "pool", "pool", im_id=7)
    assert ", all" not in said("pool", "pool", "pool")
    assert step() is None


def test_without_ground_truth_the_lowest_score_comes_first() -> None:
    rows = tuple(row(k, has_truth=False, add_s_mm=None, score=score) for k, score in ((1, 0.9), (2, 0.1)))
    found = next_step(group("rir", rows))
    assert found is not None
    assert "begin with the lowest score" in found.text
    assert found.begin.im_id == 2


def test_every_cause_has_advice_that_fits_the_method() -> None:
    for cause, method in itertools.product(Cause, ALL_METHOD_NAMES):
        words = advice(cause, method)
        is_of_the_tree = method == "physim_mcts" and cause in (Cause.ARM_STARVED, Cause.BUDGET)
        assert ("mcts." in words) == is_of_the_tree, (cause, method)
        # Only these weigh exploration against what they know.
        assert "method.exploration" not in words or method in ("rir", "vf_breadth", "vf_depth"), (cause, method)
