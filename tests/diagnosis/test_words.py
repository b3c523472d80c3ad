"""What is said about numbers that hardly differ."""

from __future__ import annotations

import math
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from verefine_viz.core.scores import PIXEL_CLASSES, PoseScore
from verefine_viz.diagnosis.number_words import MORE_DIGITS, distinct_texts, instead
from verefine_viz.diagnosis.preferred_poses import preferred


@pytest.mark.parametrize(
    ("a", "b", "digits", "kind", "texts"),
    [
        (0.8291, 0.8294, 3, "f", ("0.8291", "0.8294")),
        (0.829, 0.829 + 1e-9, 3, "f", ("0.829", "0.829")),
        (0.104, 0.096, 0, "%", ("10.4%", "9.6%")),
    ],
)
def test_numbers_get_the_digits_in_which_they_differ(
    a: float, b: float, digits: int, kind: Literal["f", "%"], texts: tuple[str, str]
) -> None:
    assert distinct_texts(a, b, digits, kind) == texts


@given(st.floats(0, 1), st.floats(0, 1), st.integers(0, 4))
def test_numbers_that_look_the_same_are_nearly_the_same(a: float, b: float, digits: int) -> None:
    said_a, said_b = distinct_texts(a, b, digits)
    if said_a == said_b:
        assert abs(a - b) <= 1.001 * 10.0 ** -(digits + MORE_DIGITS)
    else:
        assert (float(said_a) < float(said_b)) == (a < b)


def test_what_a_re_run_changed() -> None:
    assert instead(0.099, 0.101) == "the error is 9.9% of the diameter instead of 10.1%"
    assert "still 30%" in instead(0.3, 0.3)
    assert instead(0.3, math.inf).endswith("instead of no answer")
    assert instead(math.inf, 0.3) == "there is no answer at all"


def score(value: float, depth_fit: float, missed: int = 0) -> PoseScore:
    counts = tuple(missed if name == "missed" else 100 - missed if name == "explained" else 0 for name in PIXEL_CLASSES)
    return PoseScore(value, depth_fit, 0.9, 100, 100, counts)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize(
    ("wrong", "right", "said"),
    [
        (score(0.82926, 0.801), score(0.82914, 0.799), "0.8293 against 0.8291 for the ground truth, whose depth fits"),
        (score(0.8, 0.8), score(0.8, 0.8), "as much as the ground truth: 0.800"),
        (score(0.9, 0.8), score(0.8, 0.8, missed=20), "in which 20% of the pixels count as missed"),
    ],
)
def test_by_how_much_and_why_the_score_prefers_the_wrong_pose(wrong: PoseScore, right: PoseScore, said: str) -> None:
    assert said in preferred("mug", 0.11, wrong, right)
