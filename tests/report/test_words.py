"""Numbers as sentences and tables show them."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.report.html import breakable
from verefine_viz.report.words import signed, tone


@pytest.mark.parametrize(
    ("value", "shown"), [(0.0, "0.0"), (-0.04, "0.0"), (0.04, "0.0"), (-0.06, "−0.1"), (2.0, "+2.0"), (-12.34, "−12.3")]
)
def test_what_rounds_to_zero_has_no_sign(value: float, shown: str) -> None:
    assert signed(value) == shown


@given(st.floats(allow_nan=True, allow_infinity=True), st.integers(0, 3))
def test_what_shows_as_zero_has_no_colour(value: float, digits: int) -> None:
    shown = signed(value, digits)
    if math.isfinite(value):
        assert (tone(value, digits) == "") == (float(shown.replace("−", "-")) == 0.0)
    else:
        assert tone(value, digits) == ("" if math.isnan(value) else "good" if value > 0 else "bad")


def test_names_break_between_words_and_not_in_numbers() -> None:
    assert breakable("icp.stop max_iterations 0.7 <b>") == "icp.<wbr>stop max_<wbr>iterations 0.7 &lt;b&gt;"
