"""Lines over the page: the window is too small for all panels, or the program cannot be reached."""

from __future__ import annotations

USUAL_PORT = 8080

# While the websocket is lost, the library's client keeps the panels, inside an element that it makes translucent and
# deaf (DisconnectedGate in its ControlPanel/Generated.tsx), and goes on trying to connect. The rule looks for it around
# one of our blocks. Should it look different one day, there is no line; nothing else depends on it.
_LOST = 'body:has([style*="opacity: 0.5"][style*="pointer-events: none"] .vz)::after'


def lost_words(port: int) -> str:
    """What has happened, and what to do; the page finds the program again at its own port only."""
    command = "verefine-viz view …" + (f" --port {port}" if port != USUAL_PORT else "")
    said = "The program has ended (or cannot be reached). Start it again"
    return f"{said}: {command}; this page then connects by itself."


def lost_style(port: int) -> str:
    """A style with the line, for a widget of HTML; ``port`` is the page's."""
    return (
        f'<style>{_LOST}{{content:"{lost_words(port)}";position:fixed;z-index:10000;top:8px;left:50%;'
        "transform:translateX(-50%);width:max-content;max-width:90vw;padding:8px 14px;border-radius:4px;"
        "background:#b3261e;color:#fff;font:14px/1.4 sans-serif;box-shadow:0 2px 10px rgba(0,0,0,.5)}</style>"
    )


# A line for windows in which the panels lie over each other, be they small or zoomed in; others do not show it.

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
