"""Colours of hypotheses are told apart by everyone, and mistaken for nothing that means something."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, CLASS_COLORS, EVENT_COLORS, RGB, STAGE_COLORS

TO_LMS = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
TO_OKLAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
"""Ottosson 2020."""
SEEN = {
    "by most": np.eye(3),
    "without red cones": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "without green cones": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
}
"""Machado, Oliveira and Fernandes 2009, severity 1; of linear RGB."""


def oklab(color: RGB, seen: str) -> Float:
    """A colour as it is seen, in 100 × OKLab: a distance of 2 is just noticed."""
    c = np.array(color) / 255
    linear = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return 100 * TO_OKLAB @ np.cbrt(TO_LMS @ np.clip(SEEN[seen] @ linear, 0, 1))


def distance(a: RGB, b: RGB, seen: str = "by most") -> float:
    return float(np.linalg.norm(oklab(a, seen) - oklab(b, seen)))


@pytest.mark.parametrize("seen", SEEN)
def test_colours_of_hypotheses_differ_for_everyone(seen: str) -> None:
    assert min(distance(a, b, seen) for a, b in combinations(ARM_COLORS[:5], 2)) > 12
    assert min(distance(a, b, seen) for a, b in combinations(ARM_COLORS, 2)) > 6


def test_colours_of_hypotheses_are_not_those_of_stages_classes_and_marks() -> None:
    grey = {"initial", "current", "no_physics", "hidden", "unknown"}
    named = {**STAGE_COLORS, **CLASS_COLORS, **EVENT_COLORS}
    for name, color in named.items():
        if name not in grey:
            assert min(distance(color, arm) for arm in ARM_COLORS) > 8, name
