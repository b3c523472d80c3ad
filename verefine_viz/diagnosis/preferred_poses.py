"""Sentences about a wrong pose that the score prefers to ground truth, and the pixels that decide it."""

from __future__ import annotations

from verefine_viz.core.scores import PoseScore
from verefine_viz.diagnosis.number_words import distinct_texts

BLAMED = ("missed", "protruding")
"""Classes that cost a pose its score."""


def preferred(
    name: str, error: float, wrong: PoseScore, right: PoseScore, way: str = "", whose: str = "The score"
) -> str:
    """The sentence about a score that prefers a wrong pose, or gives it as much as the ground truth.

    Args:
        name: of the object.
        error: of the wrong pose, as a share of the diameter.
        wrong: its score.
        right: that of ground truth, which is not higher.
        way: which way the pose is turned, in words.
        whose: score it is: the object's, or that of its scene.
    """
    pose = f"a pose of the {name} that is wrong by {error:.0%} of the diameter{way}"
    of_wrong, of_gt = distinct_texts(wrong.score, right.score, 3)
    if of_wrong == of_gt:
        return f"{whose} gives {pose} as much as the ground truth: {of_gt}."
    return f"{whose} prefers {pose}: {of_wrong} against {of_gt} for the ground truth{_explanation(wrong, right)}."


def blamed_pixels(wrong: PoseScore, right: PoseScore) -> str | None:
    """The class of pixels that costs ground truth its lead over a wrong pose; None where neither class does."""
    more = {name: right.shares[name] - wrong.shares[name] for name in BLAMED}
    name = max(more, key=lambda n: more[n])
    return name if more[name] > 0.01 else None


def _explanation(wrong: PoseScore, right: PoseScore) -> str:
    """Words for what costs ground truth its lead: pixels, else the fit; empty where neither shows it."""
    if not (wrong.has_parts and right.has_parts):
        return ""
    name = blamed_pixels(wrong, right)
    if name is not None:
        what = {"missed": "missed (measured, and no model there)", "protruding": "protruding into free space"}[name]
        shares = f"{right.shares[name]:.0%} of the pixels count as {what}"
        return f", in which {shares}, against {wrong.shares[name]:.0%} in the answer"
    depth, normals = wrong.depth_fit - right.depth_fit, wrong.normal_fit - right.normal_fit
    if depth > normals:
        what, fits = "depth fits", distinct_texts(right.depth_fit, wrong.depth_fit, 2)
    else:
        what, fits = "normals fit", distinct_texts(right.normal_fit, wrong.normal_fit, 2)
    if max(depth, normals) <= 0 or fits[0] == fits[1]:
        return ""
    return f", whose {what} less well ({fits[0]} against {fits[1]})"
