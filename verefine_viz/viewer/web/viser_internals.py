"""What reaches into the private parts of viser, written for version 1.1.

Its widgets are found by ``_impl.uuid``, which labels name; its page by class names of Mantine, attributes of its docks
and ``window.__viserMutable``. Should any of it look different one day, rows are higher, keys go to viser and the notice
of a lost program is missing; nothing else depends on it. The patch of its web server is in ``web/server.py``.
"""

from __future__ import annotations

from typing import Any

LINK_LABEL = "page link"
"""Label of the hidden text field through which links send their commands."""

CANCEL_CLASS = "cancel"
"""Class of the line with the link that Escape stands for."""


def label_of(handle: Any) -> str:
    """The selector of a widget's label."""
    return f'label[for="{handle._impl.uuid}"]'


def _row(handle: Any) -> str:
    """The selector of a widget with its label, which ``assets/page_marks.js`` marks; inside of it stands one box."""
    return f'[data-row="{handle._impl.uuid}"]'


def hidden(handle: Any) -> str:
    """A style that takes a widget from the screen; it stays in use."""
    return f"{_row(handle)}{{position:absolute;width:1px;height:1px;overflow:hidden;visibility:hidden}}"


def compact(handle: Any, row_px: int) -> str:
    """A style that takes the space around a widget with a label away, and makes its row so high [px]."""
    row = _row(handle)
    return (
        f"{row}{{padding-bottom:0!important}}{row}>.mantine-Flex-root{{height:{row_px}px}}"
        f"{row} input:not([type=checkbox]){{height:{row_px - 1}px!important;min-height:0!important}}"
    )


def side_by_side(left: Any, right: Any, row_px: int, right_from_px: int, label_px: int) -> str:
    """A style that puts two widgets that are compact into one row, with labels of that width [px].

    Where the left one is not shown, the right one has the row.
    """
    return (
        f":is({_row(left)},{_row(right)})>.mantine-Flex-root>div:first-child{{width:{label_px}px!important}}"
        f"{_row(left)}{{width:{right_from_px}px}}{_row(left)}~{_row(right)}{{margin:-{row_px}px 0 0 {right_from_px}px}}"
    )


def unlabelled(handle: Any) -> str:
    """A style that gives the place of a widget's label to the widget."""
    return f"{_row(handle)}>.mantine-Flex-root>div:first-child{{display:none}}"


def without_ends(handle: Any) -> str:
    """A style that leaves out the numbers at the ends of a slider, which its knob would cover."""
    return f"{_row(handle)} .mantine-Slider-markLabel{{display:none}}"


def beside_the_box(handle: Any, row_px: int, from_px: int) -> str:
    """A style that moves a widget up into the row of the box before it, without its label."""
    return f"{unlabelled(handle)}{_row(handle)}{{margin:-{row_px}px 0 0 {from_px}px}}"


def lettered(handle: Any) -> str:
    """A style that writes x, y and z into the three boxes of a widget."""
    boxes = f"{_row(handle)} .mantine-NumberInput-root"
    letters = "".join(f'{boxes}:nth-child({k})::before{{content:"{axis}"}}' for k, axis in enumerate("xyz", 1))
    return (
        f"{boxes}{{position:relative}}{boxes} input{{padding-left:14px!important}}"
        f"{boxes}::before{{position:absolute;z-index:1;left:5px;top:3px;font-size:11px;opacity:.65}}{letters}"
    )


# Lines over the page: the window is too small for all panels, or the program cannot be reached.

USUAL_PORT = 8080

# While the websocket is lost, the library's client keeps the panels, inside an element that it makes translucent and
# deaf (DisconnectedGate in its ControlPanel/Generated.tsx), and goes on trying to connect. The rule looks for it around
# one of our blocks. Should it look different one day, there is no line; nothing else depends on it.
_LOST = 'body:has([style*="opacity: 0.5"][style*="pointer-events: none"] .vz)::after'


def lost_words(port: int) -> str:
    """What has happened, and what to do; the page finds the program again at its own port only."""
    command = "verefine-viz view …" + (f" --port {port}" if port != USUAL_PORT else "")
    return (
        f"The program has ended (or cannot be reached). Start it again: {command}; this page then connects by itself."
    )


def lost_style(port: int) -> str:
    """A style with the line, for a widget of HTML; ``port`` is the page's."""
    return (
        f'<style>{_LOST}{{content:"{lost_words(port)}";position:fixed;z-index:10000;top:8px;left:50%;'
        "transform:translateX(-50%);width:max-content;max-width:90vw;padding:8px 14px;border-radius:4px;"
        "background:#b3261e;color:#fff;font:14px/1.4 sans-serif;box-shadow:0 2px 10px rgba(0,0,0,.5)}</style>"
    )


# A line for windows in which the panels lie over each other, be they small or zoomed in; others do not show it.

WIDTH_PX, HEIGHT_PX = 1280, 640
"""The smallest window for which the panels are placed."""
SMALL_WINDOW = (
    f"The window is too small for all panels (they need {WIDTH_PX} × {HEIGHT_PX}): make it larger, or zoom out with "
    "Ctrl and −."
)


def small_window() -> str:
    """The line, and a style that shows it where it is true."""
    return (
        "<style>.small-window{display:none}"
        f"@media (max-width:{WIDTH_PX - 1}px),(max-height:{HEIGHT_PX - 1}px){{.small-window{{display:block}}}}</style>"
        f'<div class="vz small-window"><p class="warn">{SMALL_WINDOW}</p></div>'
    )
