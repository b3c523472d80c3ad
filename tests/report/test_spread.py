"""Intervals by the bootstrap: what must hold of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from verefine_viz.report.bootstrap import Cells, draws

RNG = np.random.default_rng(3)


def test_draws_are_the_same_at_each_call_and_nothing_is_said_of_nothing() -> None:
    first, second = draws(5, 3), draws(5, 3)
    assert (first.units == second.units).all()
    assert (first.seeds == second.seeds).all()
    assert set(first.units.sum(axis=1)) == {5.0}
    assert set(first.seeds.sum(axis=1)) == {3.0}
    nothing = Cells(np.zeros((2, 2)), np.zeros((2, 2)))
    assert draws(2, 2).mean(nothing) is None
    assert draws(2, 2).median(np.zeros(0), np.zeros(0, int), np.zeros(0, int)) is None


@settings(max_examples=30)
@given(st.integers(1, 6), st.integers(1, 6), st.integers(0, 1000))
def test_an_interval_holds_the_value_of_a_mean(n_units: int, n_seeds: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 5, (n_units, n_seeds)).astype(float)
    found = draws(n_units, n_seeds).mean(Cells(n * rng.random((n_units, n_seeds)), n))
    if n_units == n_seeds == 1:
        assert (found.low, found.high) == (None, None)
        return
    assert found.low is not None
    assert found.high is not None
    assert found.low <= found.high + 1e-12
    assert found.low >= 0.0
    assert found.high <= 1.0 + 1e-12


def test_the_interval_of_a_mean_agrees_with_the_theory() -> None:
    """Independent frames, one seed: the interval is close to mean ± 1.96 σ/√n."""
    values = RNG.random((400, 1))
    found = draws(400, 1).mean(Cells(values, np.ones((400, 1))))
    half = 1.96 * values.std() / np.sqrt(400)
    assert (found.low, found.high) == pytest.approx((values.mean() - half, values.mean() + half), abs=0.15 * half)


def test_a_difference_is_paired() -> None:
    """Frames differ far more than the groups do; only the pairs show the difference."""
    frames = RNG.random((40, 1)) * np.ones((1, 3))
    a, b = Cells(frames, np.ones_like(frames)), Cells(frames - 0.05, np.ones_like(frames))
    drawn = draws(40, 3)
    difference, mean = drawn.difference(a, b), drawn.mean(a)
    assert difference.is_clear
    assert (difference.value, difference.low, difference.high) == pytest.approx((0.05, 0.05, 0.05))
    assert mean.low is not None
    assert mean.value - mean.low > 0.05


def test_a_difference_is_over_what_both_have() -> None:
    ones = np.ones((4, 2))
    a, b = Cells(ones.copy(), ones.copy()), Cells(np.zeros((4, 2)), ones.copy())
    b.n[:, 1] = 0
    a.total[:, 1] = 0
    found = draws(4, 2).difference(a, b)
    assert found.value == 1.0
    b.n[:] = 0
    assert draws(4, 2).difference(a, b) is None


def test_seeds_widen_an_interval_as_frames_do() -> None:
    by_seed = np.ones((5, 1)) * RNG.random((1, 20))
    found = draws(5, 20).mean(Cells(by_seed, np.ones_like(by_seed)))
    alone = draws(5, 1).mean(Cells(by_seed[:, :1], np.ones((5, 1))))
    assert found.low is not None
    assert found.high is not None
    assert found.high - found.low > 0.1
    assert alone.low == pytest.approx(alone.high)


@given(st.lists(st.floats(-100, 100), min_size=1, max_size=30))
def test_a_median_is_numpys_and_lies_in_its_interval(values: list[float]) -> None:
    column = np.array(values)
    unit = np.arange(len(column)) % 3
    found = draws(3, 1).median(column, unit, np.zeros(len(column), int))
    assert found.value == np.median(column)
    assert found.low is not None
    assert found.high is not None
    assert min(values) <= found.low <= found.high <= max(values)
