"""The sentence above the breakpoints: where a run stops now."""

from __future__ import annotations

from verefine_viz.core.breakpoint_settings import BreakpointSettings
from verefine_viz.session.breakpoints import UNITS

NAMES = {
    "simulated_rejected": "simulated pose rejected",
    "refined_rejected": "refined pose rejected",
    "arm_switched": "other hypothesis",
    "unstable": "unstable",
    "physics_worse": "physics made it worse",
    "empty_render": "empty render",
}
"""Breakpoints without a number, in words."""
CHANGES = {
    "score_falls_by": "score fell by",
    "jump_mm": "moved",
    "jump_deg": "turned",
    "error_grows_by_mm": "error grew",
}
"""The others."""


def breakpoint_words(settings: BreakpointSettings) -> str:
    """As in: A run stops where: moved more than 25 mm, unstable."""
    over = [
        f"{words} more than {value:g}{UNITS[name]}"
        for name, words in CHANGES.items()
        if (value := getattr(settings, name)) is not None
    ]
    ticked = [words for name, words in NAMES.items() if getattr(settings, name)]
    if not over and not ticked:
        return "A run stops nowhere before its end: tick what should stop it."
    return f"A run stops where: {', '.join((*over, *ticked))}."
