"""Means, bands and verdicts of made-up outcomes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from verefine_viz.run.record import Answer
from verefine_viz.studies.claims import lines, missing_curves, points_of, rows, verdicts
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_plan import Claim, Panel, Study, StudyCurve


def _panel() -> Panel:
    curves = (StudyCurve("A", {}), StudyCurve("B", {}))
    return Panel("p", "x", (0.0, 1.0), curves, lambda problem, x, seed: problem, (Claim("A", "B"),))


def _outcome(curve: str, x: float, k: int, ar: float, seed: int = 0) -> UnitAnswer:
    """Of object ``k``, alone in its frame."""
    found = Answer(
        frame=f"0/{k}", seed=seed, instance_id=0, obj_id=1, status="ok", ar=ar, ar_vsd=ar, ar_mssd=ar, ar_mspd=ar,
        add_s_mm=1.0, diameter_mm=20.0, rotation_deg=2.0, translation_mm=3.0,
    )  # fmt: skip
    return UnitAnswer(panel="p", x=x, scene="s", curve=curve, answer=found, ms=2.0, refiner_calls=3.0)


def _with(o: UnitAnswer, **changed: object) -> UnitAnswer:
    """With another answer."""
    return structs.replace(o, answer=structs.replace(o.answer, **changed))


@given(st.lists(st.floats(0, 1), min_size=1, max_size=20))
@settings(max_examples=30, deadline=None)
def test_a_line_is_the_mean_and_lies_in_its_band(values: list[float]) -> None:
    outcomes = [_outcome(c, x, k, v) for c in "AB" for x in (0.0, 1.0) for k, v in enumerate(values)]
    for line in lines(_panel(), points_of(outcomes)):
        np.testing.assert_allclose(line.ar, np.mean(values), atol=1e-12)
        assert (line.low <= line.ar + 1e-12).all()
        assert (line.ar <= line.high + 1e-12).all()


def test_verdicts_look_at_pairs_and_gains_that_cancel_are_too_close_to_tell() -> None:
    for gain, word in ((0.2, "holds"), (-0.2, "does not hold"), (0.0, "the same")):
        rng = np.random.default_rng(0)
        hard = rng.uniform(0.3, 0.7, 30)  # frames differ far more than the curves
        outcomes = [_outcome("A", 0.0, k, float(v + gain)) for k, v in enumerate(hard)]
        outcomes += [_outcome("B", 0.0, k, float(v)) for k, v in enumerate(hard)]
        (verdict,) = verdicts(_panel(), points_of(outcomes))
        assert verdict.word == word, (gain, word)
        assert verdict.spread.value == pytest.approx(gain), (gain, word)
        assert f"A over B: {word}" in str(verdict), (gain, word)
    outcomes = [_outcome("A", 0.0, k, 0.5 + 0.1 * (-1) ** k) for k in range(10)]
    outcomes += [_outcome("B", 0.0, k, 0.5) for k in range(10)]
    (verdict,) = verdicts(_panel(), points_of(outcomes))
    assert verdict.word == "too close to tell"


def test_a_handful_of_objects_shows_nothing_even_if_all_gain() -> None:
    for n, word in ((1, "too few to tell"), (5, "too few to tell"), (6, "holds")):
        outcomes = [_outcome("A", 0.0, k, 0.5 + 0.05 * (k + 1)) for k in range(n)]
        outcomes += [_outcome("B", 0.0, k, 0.5) for k in range(n)]
        (verdict,) = verdicts(_panel(), points_of(outcomes))
        assert verdict.n_objects == n
        assert verdict.word == word, (n, word)


def test_more_errors_and_seeds_of_the_same_objects_make_no_interval_narrower() -> None:
    gains = np.random.default_rng(1).normal(0.02, 0.05, 8)
    once = [_outcome("A", 0.0, k, 0.5 + float(g)) for k, g in enumerate(gains)]
    once += [_outcome("B", 0.0, k, 0.5) for k in range(8)]
    more_errors = [*once, *(structs.replace(o, x=1.0) for o in once)]
    more_seeds = [_with(o, seed=seed) for o in once for seed in range(20)]
    (alone,), *others = (verdicts(_panel(), points_of(found)) for found in (once, more_errors, more_seeds))
    for (repeated,) in others:
        assert (repeated.spread.low, repeated.spread.high) == pytest.approx((alone.spread.low, alone.spread.high))
        assert repeated.n_objects == 8
    bands = [lines(_panel(), points_of(found))[0] for found in (once, more_seeds)]
    assert bands[1].low[0] == pytest.approx(bands[0].low[0])


def test_differences_have_the_digits_that_tell_them_from_nothing() -> None:
    for gain, number in ((0.2, "+20.0"), (0.004, "+0.4"), (0.0003, "+0.03"), (-0.00004, "-0.004")):
        outcomes = [_outcome("A", 0.0, k, 0.5 + gain) for k in range(6)]
        outcomes += [_outcome("B", 0.0, k, 0.5) for k in range(6)]
        (verdict,) = verdicts(_panel(), points_of(outcomes))
        assert verdict.numbers == f"{number} ({number} to {number})"


def test_a_claim_about_low_errors_leaves_out_high_ones() -> None:
    panel = replace(_panel(), claims=(Claim("A", "B", to_x=0.0), Claim("B", "A", from_x=1.0), Claim("A", "B")))
    outcomes = [_outcome("A", x, k, 0.7 - 0.4 * x) for x in (0.0, 1.0) for k in range(6)]
    outcomes += [_outcome("B", x, k, 0.5) for x in (0.0, 1.0) for k in range(6)]
    low, high, every = verdicts(panel, points_of(outcomes))
    assert (low.spread.value, high.spread.value, every.spread.value) == pytest.approx((0.2, 0.2, 0.0))
    assert (low.word, high.word) == ("holds", "holds")


@pytest.mark.parametrize(
    ("here", "there", "word"), [(0.2, 0.1, "holds"), (0.1, 0.2, "does not hold"), (0.1, 0.1, "the same")]
)
def test_a_gain_is_compared_with_that_of_the_same_objects_in_another_panel(
    here: float, there: float, word: str
) -> None:
    panel = replace(_panel(), claims=(Claim("A", "B", than="q"),))
    outcomes = list[UnitAnswer]()
    for k, hard in enumerate(np.random.default_rng(0).uniform(0.3, 0.7, 30)):  # Objects differ more than the gains.
        for name, gain in (("p", here), ("q", there)):
            pair = (_outcome("A", 0.0, k, float(hard) + gain), _outcome("B", 0.0, k, float(hard)))
            outcomes += [structs.replace(o, panel=name) for o in pair]
    outcomes.append(_outcome("A", 1.0, 0, 1.0))  # In no pair, and not in the other panel.
    (verdict,) = verdicts(panel, points_of(outcomes))
    assert (verdict.word, verdict.n_objects) == (word, 30)
    assert verdict.spread.value == pytest.approx(here - there)
    alone = points_of(o for o in outcomes if o.panel == "p")
    assert verdicts(panel, alone) == []


def test_answers_that_are_missing_count_nowhere_and_have_their_reason() -> None:
    outcomes = [_outcome(c, 0.0, k, 0.5) for c in "AB" for k in range(3)]
    outcomes = [_with(o, status="failed", message="no weights") if o.curve == "B" else o for o in outcomes]
    points = points_of(outcomes)
    assert [r["curve"] for r in rows(Study("s", "t", (_panel(),)), points)] == ["A"]
    assert verdicts(_panel(), points) == []
    assert missing_curves(outcomes) == {("p", "B"): "no weights"}


def test_a_row_per_curve_and_x_and_pairs_without_a_partner_are_left_out() -> None:
    outcomes = [_outcome(c, x, 0, 0.5) for c in "AB" for x in (0.0, 1.0)]
    found = list(rows(Study("s", "t", (_panel(),)), points_of(outcomes)))
    assert [(r["curve"], r["x"], r["n"]) for r in found] == [("A", 0.0, 1), ("A", 1.0, 1), ("B", 0.0, 1), ("B", 1.0, 1)]
    assert all(r["ms_per_object"] == 2.0 and r["below_10_percent"] == 1.0 for r in found)
    assert all(r["rotation_deg"] == 2.0 and r["translation_cm"] == pytest.approx(0.3) for r in found)
    outcomes = [_outcome("A", 0.0, 0, 0.9), _outcome("B", 0.0, 0, 0.4), _outcome("A", 1.0, 0, 0.0)]
    (verdict,) = verdicts(_panel(), points_of(outcomes))
    assert verdict.spread.value == pytest.approx(0.5)
    assert verdicts(_panel(), points_of(outcomes[:1])) == []


def test_no_answer_passes_no_threshold() -> None:
    nothing = Answer(frame="0/0", status="no_answer")
    without = UnitAnswer(panel="p", x=0.0, scene="s", curve="A", answer=nothing)
    assert [without.recall(metric) for metric in ("ar", "ar_vsd", "ar_mssd", "ar_mspd")] == [0.0] * 4
    assert without.missing == ""
