"""Outcomes of a grasp."""

from __future__ import annotations

from typing import Literal

Verdict = Literal[
    "success",
    "slipped",
    "no contact",
    "collided with the target",
    "collided with a neighbour",
    "collided with the ground",
    "no collision-free grasp",
]
"""Outcome of a grasp; with the last one no grasp is carried out."""
