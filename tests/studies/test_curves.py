"""Means, bands and verdicts of made-up outcomes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.fakes import box_problem
from verefine_viz.core.geometry import axis_angle, transform
from verefine_viz.studies.figure import lines, points_of, rows, verdicts
from verefine_viz.studies.solve_unit import Outcome, Quality, quality
from verefine_viz.studies.study_plan import Claim, Curve, Panel, Study


def _panel() -> Panel:
    curves = (Curve("A", {}), Curve("B", {}))
    return Panel("p", "x", (0.0, 1.0), curves, lambda problem, x, seed: problem, (Claim("A", "B"),))


def _outcome(curve: str, x: float, seed: int, ar: float) -> Outcome:
    found = Quality(ar_vsd=ar, ar_mssd=ar, ar_mspd=ar, add_s_mm=1.0, relative=0.05)
    return Outcome(
        panel="p", x=x, seed=seed, scene="s", frame="0/0", curve=curve, instance_id=0, obj_id=1,
        quality=found, ms=2.0, refiner_calls=3.0,
    )  # fmt: skip


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
        assert verdict.difference == pytest.approx(gain), (gain, word)
        assert f"A over B: {word}" in str(verdict), (gain, word)
    outcomes = [_outcome("A", 0.0, k, 0.5 + 0.1 * (-1) ** k) for k in range(10)]
    outcomes += [_outcome("B", 0.0, k, 0.5) for k in range(10)]
    (verdict,) = verdicts(_panel(), points_of(outcomes))
    assert verdict.word == "too close to tell"


def test_a_handful_of_pairs_shows_nothing_even_if_all_gain() -> None:
    for n, word in ((1, "too few to tell"), (5, "too few to tell"), (6, "holds")):
        outcomes = [_outcome("A", 0.0, k, 0.5 + 0.05 * (k + 1)) for k in range(n)]
        outcomes += [_outcome("B", 0.0, k, 0.5) for k in range(n)]
        (verdict,) = verdicts(_panel(), points_of(outcomes))
        assert verdict.low > 0, (n, word)
        assert verdict.word == word, (n, word)


def test_what_one_disturbance_does_at_many_x_counts_as_one_piece_of_evidence() -> None:
    gains = np.random.default_rng(1).normal(0.02, 0.05, 8)
    once = [_outcome("A", 0.0, k, 0.5 + float(g)) for k, g in enumerate(gains)]
    once += [_outcome("B", 0.0, k, 0.5) for k in range(8)]
    twice = [*once, *(structs.replace(o, x=1.0) for o in once)]
    (alone,), (repeated,) = (verdicts(_panel(), points_of(found)) for found in (once, twice))
    assert (repeated.low, repeated.high) == pytest.approx((alone.low, alone.high))


def test_a_row_per_curve_and_x_and_pairs_without_a_partner_are_left_out() -> None:
    outcomes = [_outcome(c, x, 0, 0.5) for c in "AB" for x in (0.0, 1.0)]
    found = list(rows(Study("s", "t", (_panel(),)), points_of(outcomes)))
    assert [(r["curve"], r["x"], r["n"]) for r in found] == [("A", 0.0, 1), ("A", 1.0, 1), ("B", 0.0, 1), ("B", 1.0, 1)]
    assert all(r["ms_per_object"] == 2.0 and r["below_10_percent"] == 1.0 for r in found)
    outcomes = [_outcome("A", 0.0, 0, 0.9), _outcome("B", 0.0, 0, 0.4), _outcome("A", 1.0, 0, 0.0)]
    (verdict,) = verdicts(_panel(), points_of(outcomes))
    assert verdict.difference == pytest.approx(0.5)
    assert verdicts(_panel(), points_of(outcomes[:1])) == []


def test_quality_is_full_for_the_truth_nothing_without_an_answer_and_falls_with_the_error() -> None:
    problem = box_problem()
    target = problem.targets[0]
    T_gt = target.instance.T_cam_obj_gt
    assert quality(target, T_gt, problem).ar == 1.0
    assert quality(target, None, problem).ar == 0.0
    found = []
    for step in range(6):
        T = T_gt @ transform(axis_angle(np.array([1.0, 0, 0]), np.radians(4 * step)), np.array([0.01 * step, 0, 0]))
        found.append(quality(target, T, problem).ar)
    assert found == sorted(found, reverse=True)
    assert found[-1] < 0.8
