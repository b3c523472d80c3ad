"""The drawings of the score around an answer."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from verefine_viz.evaluation.landscape import Axis, Curve, Landscape
from verefine_viz.pictures.landscape_picture import curve_svg, worst_curves

OFFSETS = np.array([-4.0, -1, 0, 1, 4])


def axis(kind: str = "turn", words: str = "turn about <its> z") -> Axis:
    return Axis(kind, "object", "z", np.array([0.0, 0, 1]), np.zeros(3), words)  # pyright: ignore[reportArgumentType]


def curve(
    low: float, high: float, scores: tuple[float, ...] = (0.5, 0.88, 0.9, 0.89, 0.7), kind: str = "turn"
) -> Curve:
    noise = np.array([0.01, 0.01, 0, 0.01, 0.01])
    return Curve(axis(kind), OFFSETS, np.array(scores), noise, low, high)


def test_what_is_undetermined_is_shaded_between_the_samples_that_hold_it() -> None:
    svg = ElementTree.fromstring(curve_svg(curve(-1, 2.5), width=100))
    shaded = next(r for r in svg.iter("rect") if r.get("opacity") == "0.3")
    # Five samples at 10, 30, …, 90: −1 is the second, 2.5 half-way from the fourth to the last.
    assert float(shaded.attrib["x"]) == pytest.approx(30, abs=0.1)
    assert float(shaded.attrib["width"]) == pytest.approx(50, abs=0.1)
    assert "undetermined within ±2.5°" in "".join(svg.itertext())


@pytest.mark.parametrize("scores", [(0.0,) * 5, (0.9,) * 5, (0.1, 0.2, 0.3, 0.4, 1.0)])
def test_any_curve_can_be_drawn(scores: tuple[float, ...]) -> None:
    svg = curve_svg(curve(-4, 4, scores))
    assert "nan" not in svg
    assert ElementTree.fromstring(svg).find("polyline") is not None


def test_the_worst_shift_and_the_worst_turn_are_chosen() -> None:
    curves = curve(-1, 1), curve(-2, 0), curve(0, 1, kind="shift"), curve(0, 3, kind="shift")
    shift, turn = worst_curves(Landscape(np.eye(4), 0.9, curves, 50.0))
    assert (shift.high, turn.low) == (3, -2)
