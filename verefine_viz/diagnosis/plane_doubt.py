"""Doubts that the measured support plane is the one that supports the objects."""

from __future__ import annotations

from verefine_viz.core.observation import Support

PLANE_SHARE = 0.4
"""A plane that holds less of the background is doubted. Right ones of the eight YCB-Video frames at hand hold 43-74 %,
walls in them 24-37 %, the board beside the box of the built-in failure 23 %."""


def plane_doubt(support: Support) -> str:
    """Why physics may use a wrong plane, and what to do about it; empty where there is no doubt."""
    if support.inlier_share >= PLANE_SHARE:
        return ""
    remedy = "give scene.gravity as a vector, or as world where the data set has camera poses"
    if support.gravity_source != "plane":
        remedy = "choose a frame that shows more of the table"
    return (
        f"The support plane explains only {support.inlier_share:.0%} of the background: physics may rest on a wrong "
        f"plane. If it cuts through objects in 3D, {remedy}."
    )
