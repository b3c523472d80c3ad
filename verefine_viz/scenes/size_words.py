"""What is said about the sizes and places of objects beside their models in true poses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from verefine_viz.core.arrays import Float

Cause = Literal[
    "focal length",
    "one focal length",
    "principal point",
    "image",
    "models",
    "focal length or models",
    "distances",
    "masks",
    "depth",
]
PLAIN_SIDE = 0.04
"""Of width and height, one that is off by less than this is right."""
LITTLE = 0.25
"""A side of a displacement that is less than this share of the other is not worth a word."""


@dataclass(frozen=True)
class Verdict:
    """What is to be said about the sizes and distances of objects."""

    found: str
    advice: str = ""
    """What to do about it; empty = nothing."""
    cause: Cause | None = None


def alike() -> Verdict:
    """Where nothing is off."""
    return Verdict("objects appear as large as their models in their true poses")


def about_depth(depth: float) -> Verdict:
    """Where sizes are right, and measured depth is ``depth`` times the true one."""
    return Verdict(
        f"{alike().found}, but measured depth is {percent(depth)} {'larger' if depth > 1 else 'smaller'} than theirs",
        f"check depth_scale in scene_camera.json: {fitting(1 / depth)}",
        "depth",
    )


def about_place(beside_px: Float, is_depth_there: bool) -> Verdict:
    """Where objects lie beside their models, all as far (2,) = (u, v), and depth does so too or does not."""
    places = sideways(beside_px, (("left of", "right of"), ("above", "below")))
    found = f"objects lie {places} where their models are in their true poses"
    if not is_depth_there:
        advice = "the masks are displaced: check that they are of these images"
        return Verdict(f"{found}, but depth does not", advice, "masks")
    return Verdict(
        f"{found}, and so does depth",
        f"{middle_off(beside_px)}; check that cam_K belongs to these images, also if they were cropped, and that depth "
        "is registered to colour if the masks were made from it",
        "principal point",
    )


def about_sides(wide: float, high: float) -> Verdict:
    """Where objects appear so many times as wide, and so many times as high."""
    sides = ((wide, "wider", "narrower", "fx"), (high, "higher", "lower", "fy"))
    off = [side for side in sides if abs(np.log(side[0])) > PLAIN_SIDE]
    found = " and ".join(f"{percent(times)} {more if times > 1 else less}" for times, more, less, _ in off)
    advice = ", and ".join(f"{name} of cam_K looks {_off(times)}" for times, _, _, name in off)
    return Verdict(
        f"objects appear {found} than their models",
        f"{advice}; check that cam_K belongs to images of this size",
        "one focal length",
    )


def about_size(cause: Cause, factor: float) -> Verdict:
    """Where objects appear ``factor`` times as large as their models."""
    is_larger = factor > 1
    size, away = ("larger", "farther from") if is_larger else ("smaller", "nearer to")
    off = _off(factor)
    found = f"objects appear {percent(factor)} {size} than their models in their true poses"
    match cause:
        case "focal length":
            found += f" and lie {away} the image's centre by as much"
            advice = f"fx and fy of cam_K look {off}; check that cam_K belongs to images of this size"
        case "image":
            found += f" and lie {away} the image's upper left corner by as much"
            advice = f"cam_K looks like that of images of another size: fx, fy, cx and cy all look {off}"
        case "models":
            found += ", in the right places"
            advice = f"the models look {off}; check their unit and scale"
        case "focal length or models":
            advice = f"either fx and fy of cam_K or the models look {off}"
        case "masks":
            found += f", as they do where masks are a few pixels too {'wide' if is_larger else 'narrow'}"
            advice = ""
        case _:
            found += f" and are {'nearer' if is_larger else 'farther away'} by as much"
            advice = f"cam_t_m2c in scene_gt.json looks too {'large' if is_larger else 'small'}; check its unit"
    return Verdict(found, advice, cause)


def sideways(way_px: Float, words: tuple[tuple[str, str], tuple[str, str]]) -> str:
    """Which way (2,) = (u, v) something is, in words for less and more of either."""
    off = zip(way_px.tolist(), words, _is_much(way_px), strict=True)
    return " and ".join(f"{abs(px):.0f} px {either[px > 0]}" for px, either, is_much in off if is_much)


def middle_off(way_px: Float) -> str:
    """What is wrong with cx and cy where objects are seen so far (2,) beside where they are drawn."""
    off = zip(way_px.tolist(), ("cx", "cy"), _is_much(way_px), strict=True)
    return " and ".join(
        f"{name} of cam_K looks {abs(px):.0f} px too {'small' if px > 0 else 'large'}"
        for px, name, is_much in off
        if is_much
    )


def fitting(factor: float) -> str:
    """What would be right."""
    return f"about {factor:.2f} times as much would fit"


def _is_much(way_px: Float) -> list[bool]:
    return (np.abs(way_px) > LITTLE * np.abs(way_px).max()).tolist()


def _off(factor: float) -> str:
    return f"too {'small' if factor > 1 else 'large'}, {fitting(factor)}"


def percent(ratio: float) -> str:
    """How far a ratio is from 1."""
    return f"{abs(ratio - 1):.0%}"
