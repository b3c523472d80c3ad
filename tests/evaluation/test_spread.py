"""Intervals by the bootstrap: what must hold of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.report.runs import row
from tests.report.sections import group, section_of
from verefine_viz.evaluation.bootstrap import CellSums, draws
from verefine_viz.report.bop_recalls import BopRecalls
from verefine_viz.report.group_numbers import Axes, compare

RNG = np.random.default_rng(3)


def test_draws_are_the_same_at_each_call_and_nothing_comes_of_nothing() -> None:
    first, second = draws(5, 3), draws(5, 3)
    assert (first.units == second.units).all()
    assert (first.models == second.models).all()
    assert set(first.units.sum(axis=1)) == {5.0}
    assert set(first.models.sum(axis=1)) == {3.0}
    nothing = CellSums(np.zeros((2, 2)), np.zeros((2, 2)))
    assert draws(2, 2).mean(nothing) is None
    assert draws(2, 2).median(np.zeros(0), np.zeros(0, int), np.zeros(0, int)) is None


@settings(max_examples=30)
@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 1000))
def test_an_interval_holds_the_value_of_a_mean(n_units: int, n_models: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 5, (n_units, n_models)).astype(float)
    found = draws(n_units, n_models).mean(CellSums(n * rng.random((n_units, n_models)), n))
    if n_units == n_models == 1:
        assert (found.low, found.high) == (None, None)
        return
    assert found.low <= found.high + 1e-12
    assert found.low >= 0.0
    assert found.high <= 1.0 + 1e-12


def test_the_interval_of_a_mean_agrees_with_the_theory() -> None:
    """Independent frames of one object: the interval is close to mean ± 1.96 σ/√n."""
    values = RNG.random((400, 1))
    found = draws(400, 1).mean(CellSums(values, np.ones((400, 1))))
    half = 1.96 * values.std() / np.sqrt(400)
    assert (found.low, found.high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.15 * half)


def test_nineteen_of_twenty_intervals_hold_the_true_share() -> None:
    """Objects differ in how hard they are, and frames too: an interval over frames alone would be too narrow."""
    rng = np.random.default_rng(5)
    held = {"both": 0, "frames": 0}
    for _ in range(200):
        hard = rng.normal(0, 1, (60, 1)) + rng.normal(0, 1, (1, 20))
        right = (rng.normal(0, 1, (60, 20)) + hard > 0).astype(float)
        cells = CellSums(right, np.ones_like(right))
        both = draws(60, 20).mean(cells)
        frames = draws(60, 1).mean(CellSums(right.sum(axis=1, keepdims=True), np.full((60, 1), 20.0)))
        held["both"] += both.low <= 0.5 <= both.high
        held["frames"] += frames.low <= 0.5 <= frames.high
    assert held["both"] >= 180
    assert held["frames"] < 160


def test_more_seeds_make_no_interval_narrower() -> None:
    """The same answers again with other seeds say nothing about other objects."""
    errors = RNG.gamma(1.0, 9.0, (12, 4))
    rows = tuple(row(f, i, add_s_mm=float(error)) for (f, i), error in np.ndenumerate(errors))
    once, often = (
        compare(section_of(group("rir", *[rows] * n)), BopRecalls()).lines[0].numbers for n in (1, 20)
    )  # fmt: skip
    for name in ("recall", "mean_mm", "median_mm", "score", "calls"):
        assert (often[name].value, often[name].low, often[name].high) == pytest.approx(
            (once[name].value, once[name].low, once[name].high)
        ), name
    assert once["recall"].high - once["recall"].low > 0.1


def test_a_difference_is_paired() -> None:
    """Frames differ far more than the groups do; only the pairs show the difference."""
    frames = RNG.random((40, 1)) * np.ones((1, 3))
    a, b = CellSums(frames, np.ones_like(frames)), CellSums(frames - 0.05, np.ones_like(frames))
    drawn = draws(40, 3)
    difference, mean = drawn.difference(a, b), drawn.mean(a)
    assert difference.is_clear
    assert (difference.value, difference.low, difference.high) == pytest.approx((0.05, 0.05, 0.05))
    assert mean.value - mean.low > 0.05


def test_a_difference_is_over_what_both_have() -> None:
    ones = np.ones((4, 2))
    a, b = CellSums(ones.copy(), ones.copy()), CellSums(np.zeros((4, 2)), ones.copy())
    b.n[:, 1] = 0
    a.total[:, 1] = 0
    assert draws(4, 2).difference(a, b).value == 1.0
    b.n[:] = 0
    assert draws(4, 2).difference(a, b) is None


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=30))
def test_a_median_is_numpys_and_lies_in_its_interval(values: list[float]) -> None:
    column = np.array(values)
    found = draws(3, 1).median(column, np.arange(len(column)) % 3, np.zeros(len(column), int))
    assert found.value == np.median(column)
    assert min(values) <= found.low <= found.high <= max(values)


def test_a_drawn_median_is_that_of_what_was_drawn() -> None:
    """Whatever is drawn twice counts twice."""
    values, drawn = RNG.random(8), draws(4, 2)
    unit, model = np.arange(8) % 4, np.arange(8) // 4
    n_times = (drawn.units[:, unit] * drawn.models[:, model]).astype(int)
    medians = [np.median(np.repeat(values, n)) for n in n_times if n.sum()]
    found = drawn.median(values, unit, model)
    assert (found.low, found.high) == pytest.approx(tuple(np.percentile(medians, (2.5, 97.5))))


def test_scenes_are_drawn_where_there_are_many() -> None:
    few = Axes([group("rir", tuple(row(k, scene_id=k % 3) for k in range(9)))])
    many = Axes([group("rir", tuple(row(k, scene_id=k % 9) for k in range(18)))])
    assert (few.by_scene, few.shape) == (False, (9, 1))
    assert (many.by_scene, many.shape) == (True, (9, 1))
