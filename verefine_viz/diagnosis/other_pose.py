"""Sentences about poses that the observation cannot tell from an answer."""

from __future__ import annotations

from verefine_viz.diagnosis.number_words import distinct_texts
from verefine_viz.evaluation.allowed_poses import AlikePose, AllowedPoses

WIDE_DEG, WIDE_MM = 10.0, 5.0
"""Least undetermined turn, or shift, that is mentioned although a pose far away fits as well."""


def brief(allowed: AllowedPoses, other: AlikePose) -> str:
    """What is undetermined: "turn about the vertical undetermined within ±25°", or how far away the other pose is."""
    widest = allowed.least_certain
    reached_mm = widest.width if widest.axis.kind == "shift" else widest.width / 57.3 * allowed.radius_mm
    is_wide = widest.width > (WIDE_MM if widest.axis.kind == "shift" else WIDE_DEG)
    # A turn of ±5° says nothing about a pose 43 mm away.
    if is_wide and reached_mm > other.apart_mm / 2:
        return widest.describe()
    return f"a pose {other.apart_mm:.0f} mm away fits as well"


def unseen_error(name: str, allowed: AllowedPoses, of_answer: AlikePose) -> str:
    """Return "The observation cannot tell the answer for the mug (score up to 0.910) from a correct pose 31 mm away".

    Args:
        name: of the object.
        allowed: the poses that the image allows beside ground truth.
        of_answer: the pose among them that is next to the answer.
    """
    one, two = distinct_texts(of_answer.score, of_answer.score_of_answer, 3)
    return (
        f"The observation cannot tell the answer for the {name} (score up to {one}) from a correct pose "
        f"{of_answer.apart_mm:.0f} mm away (up to {two}): the noise of the difference is ±{of_answer.noise:.4f}; "
        f"{brief(allowed, of_answer)}."
    )


def describe(name: str, allowed: AllowedPoses, other: AlikePose) -> str:
    """Return "The observation cannot tell the answer for the mug (score up to 0.91) from another pose 31 mm away"."""
    one, two = distinct_texts(other.score_of_answer, other.score, 3)
    return (
        f"The observation cannot tell the answer for the {name} (score up to {one}) from another pose "
        f"{other.apart_mm:.0f} mm away (up to {two}): the noise of the difference is ±{other.noise:.4f}; "
        f"{brief(allowed, other)}."
    )
