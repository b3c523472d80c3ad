"""What a run's report says to do next: no more than the causes support."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

from tests.report.runs import row
from verefine_viz.batch.index import BatchIndex
from verefine_viz.batch.runs import BatchInfo
from verefine_viz.diagnosis.causes import ADVICE, Cause
from verefine_viz.methods.registry import ALL_METHOD_NAMES
from verefine_viz.report.run_results import LoadedRun
from verefine_viz.report.run_sentences import NextStep, advice, next_step
from verefine_viz.run.session_file import resolve


def step(*causes: str, method: str = "rir", n_right: int = 4, **values: Any) -> NextStep | None:
    """Of a run whose wrong answers, the worst first, have these causes."""
    known = ({"im_id": k, "add_s_mm": 90.0 - k, "name": f"box {k}", "cause": cause} for k, cause in enumerate(causes))
    wrong = [row(**(mine | values)) for mine in known]
    rows = (*(row(90 + k) for k in range(n_right)), *reversed(wrong))
    return next_step(LoadedRun("", BatchIndex(Path("run"), resolve({"method": {"name": method}}), BatchInfo(), rows)))


def said(*causes: str, **values: Any) -> str:
    found = step(*causes, **values)
    return found.text


def test_the_most_frequent_cause_leads_and_its_worst_answer_comes_first() -> None:
    found = step("pool", "arm_starved", "pool", "arm_starved", "arm_starved", "pool", "arm_starved")
    assert found.text.startswith(
        "4 of 7 wrong answers have the cause “best hypothesis tried too little” (next: no good hypothesis"
    )
    assert "in the pool 3)" in found.text
    assert "(method.iterations)" in found.text
    assert found.begin.frame == "1/1"
    assert "(next: no good hypothesis in the pool and simulation pushed it away 1 each)" in said(
        "mask", "mask", "mask", "pool", "simulation"
    )


def test_a_tie_is_said_to_be_one() -> None:
    found = step("pool", "arm_starved", "pool", "arm_starved", "mask")
    assert found.text.startswith("No cause stands out among 5 wrong answers (no good hypothesis in the pool 2, best ")
    assert found.begin.frame == "1/0"


def test_few_cases_and_causes_that_nobody_explained_are_said_to_be_so() -> None:
    assert "few cases, which say little about other frames" in said("pool", "pool", "mask")
    assert "few cases" not in said(*["pool"] * 4, "mask")
    assert said("pool").startswith("The only wrong answer of 5 has the cause “no good hypothesis in the pool”: ")
    assert "2 not explained" in said("pool", "", "pool", "", "pool")
    assert said("", "").startswith("No cause is known for 2 wrong answers; begin with the worst,")


def test_what_the_answers_have_in_common_is_said_where_it_is_all_of_them() -> None:
    assert ", all of them of the bowl: " in said("pool", "pool", "pool", name="bowl")
    assert ", all in frame 1/7: " in said("pool", "pool", "pool", im_id=7)
    assert ", all" not in said("pool", "pool", "pool")
    assert ", all" not in said("pool", name="bowl")


def test_nothing_wrong_is_nothing_to_do_and_an_unknown_cause_is_shown_as_it_is() -> None:
    assert step() is None
    assert said("moon_phase").startswith("The only wrong answer of 5 has the cause “moon phase”: look at ")


def test_without_ground_truth_the_lowest_score_comes_first() -> None:
    rows = tuple(row(k, has_truth=False, add_s_mm=None, score=score) for k, score in ((1, 0.9), (2, 0.1)))
    found = next_step(LoadedRun("", BatchIndex(Path("run"), resolve({}), BatchInfo(), rows)))
    assert (found.text, found.begin.im_id) == ("Which answers are wrong is not known; begin with the lowest score,", 2)


def test_every_cause_has_advice_that_fits_the_method() -> None:
    assert set(Cause) <= ADVICE.keys()
    for cause, method in itertools.product(Cause, ALL_METHOD_NAMES):
        told = advice(cause, method)
        is_of_the_tree = method == "physim_mcts" and cause in (Cause.ARM_STARVED, Cause.BUDGET)
        assert ("mcts." in told) == is_of_the_tree, (cause, method)
        # Only these weigh exploration against what they know.
        assert "method.exploration" not in told or method in ("rir", "vf_breadth", "vf_depth"), (cause, method)
