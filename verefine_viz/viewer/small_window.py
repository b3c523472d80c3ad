"""A line for windows in which the panels lie over each other, be they small or zoomed in; others do not show it."""

from __future__ import annotations

WIDTH_PX, HEIGHT_PX = 1280, 800
"""What the panels are placed for."""
_SLACK_PX = 40
"""How much smaller a window may be: so little is covered then that nothing need be said."""
SAID = (
    f"The window is too small for all panels (they need {WIDTH_PX} × {HEIGHT_PX}): make it larger, zoom out with "
    "Ctrl and −, or fold panels with the − at their corner."
)


def small_window(right_px: int) -> str:
    """The line, and a style that shows it where it is true and keeps floating panels off the column on the right.

    Args:
        right_px: how wide that column is.
    """
    narrow = f"(max-width:{WIDTH_PX - _SLACK_PX}px)"
    low = f"(max-height:{HEIGHT_PX - _SLACK_PX}px)"
    return (
        f"<style>.small-window{{display:none}}@media {narrow},{low}{{.small-window{{display:block}}}}"
        f"@media {narrow}{{[data-floating-window]{{max-width:calc(100vw - {right_px + 12}px)}}}}</style>"
        f'<div class="vz small-window"><p class="warn">{SAID}</p></div>'
    )
