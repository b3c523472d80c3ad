"""Colours are told apart by everyone and mistaken for nothing that means something; words are read in both themes."""

from __future__ import annotations

import re
from itertools import combinations, product

import numpy as np
import pytest

from verefine_viz.core.arrays import Float
from verefine_viz.core.palette import ARM_COLORS, CLASS_COLORS, EMPTY, EVENT_COLORS, RGB, STAGE_COLORS
from verefine_viz.page.web_files import WEB

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
    "without blue cones": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
"""Machado, Oliveira and Fernandes 2009, severity 1; of linear RGB."""
TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
"""Of linear sRGB, D65."""
GROUNDS, WORDS = ("page", "pane", "raised", "field"), ("text", "dim", "faint", "accent", "good", "seen", "bad", "doubt")


def linear(color: RGB) -> Float:
    c = np.array(color) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def oklab(color: RGB, seen: str) -> Float:
    """A colour as it is seen, in 100 × OKLab: a distance of 2 is just noticed."""
    return 100 * TO_OKLAB @ np.cbrt(TO_LMS @ np.clip(SEEN[seen] @ linear(color), 0, 1))


def cie_distance(a: RGB, b: RGB, seen: str) -> float:
    """ΔE of CIE 1976 between two colours as they are seen; 2.3 is just noticed."""

    def lab(color: RGB) -> Float:
        xyz = TO_XYZ @ np.clip(SEEN[seen] @ linear(color), 0, 1) / TO_XYZ.sum(axis=1)
        x, y, z = np.where(xyz > (6 / 29) ** 3, np.cbrt(xyz), xyz / (3 * (6 / 29) ** 2) + 4 / 29)
        return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])

    return float(np.linalg.norm(lab(a) - lab(b)))


def theme(name: str) -> dict[str, RGB]:
    """The colours of a theme of the page, by the names of their variables."""
    (block,) = re.findall(
        rf'\[data-theme="{name}"\] \{{\n(  color-scheme.*?)\}}', (WEB / "style.css").read_text(), re.DOTALL
    )
    found = re.findall(r"--([a-z-]+): #([0-9a-f]{6})[; ]", block)
    colors = {variable: bytes.fromhex(digits) for variable, digits in found}
    return {variable: (color[0], color[1], color[2]) for variable, color in colors.items()}


def contrast(a: RGB, b: RGB) -> float:
    """As WCAG 2 has it: 1 to 21."""
    low, high = sorted(float(TO_XYZ[1] @ linear(one)) for one in (a, b))
    return (high + 0.05) / (low + 0.05)


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


@pytest.mark.parametrize("seen", SEEN)
def test_classes_of_pixels_differ_for_everyone(seen: str) -> None:
    for (a, one), (b, other) in combinations([*CLASS_COLORS.items(), ("no value", EMPTY)], 2):
        assert cie_distance(one, other, seen) > 25, (a, b)


@pytest.mark.parametrize("name", ["light", "dark"])
def test_words_are_read_and_right_is_not_wrong_in_both_themes(name: str) -> None:
    colors = theme(name)
    for word, ground in product(WORDS, GROUNDS):
        assert contrast(colors[word], colors[ground]) >= 4.5, (word, ground)
    assert contrast(colors["accent-text"], colors["accent"]) >= 4.5
    for seen, good in product(SEEN, ("good", "seen")):
        assert cie_distance(colors[good], colors["bad"], seen) > 20, (good, seen)
