"""A comparison as a choice: which branch is B, and how both are shown."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.session.alignment import Key
from verefine_viz.viewer.look import STAGES
from verefine_viz.viewer.side_commands import SidePose

OF_ONE_RUN = frozenset(STAGES) - {"ground truth", "edited"} | {"hypotheses", "contacts", "path", "others", "overlaps"}
"""Layers that tell of the open run only."""


@dataclass(frozen=True)
class Sides:
    """The open branch is A; this is what stands beside it."""

    b: int
    """Index of B among the frame's branches."""
    moment: Key | None = None
    """Where on the common timeline; None = where A's cursor is."""
    poses: SidePose = "best"
    shown: frozenset[str] = frozenset("AB")
    """Whose poses are drawn in 3D."""
    hidden: frozenset[str] = OF_ONE_RUN
    """Layers that are put away meanwhile; asked for, they come back."""
