"""Whether a pose could stand like that, in words and a drawing of the support polygon."""

from __future__ import annotations

from verefine_viz.viewer.view import View


def standing_html(view: View) -> str:
    """Plausibility of the kept pose; empty where it is not known."""
    return ""
