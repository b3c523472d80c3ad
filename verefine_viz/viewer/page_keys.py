"""What the page does itself about keys where the library ignores them; nothing of it reaches Python.

The library leaves keys alone in boxes for text, and its tabs keep Space for themselves after a click on them.
"""

from __future__ import annotations

CANCEL_CLASS = "cancel"
"""Class of the line with the link that Escape stands for."""

_ON_ESCAPE = """
addEventListener("keydown", event => {
  if (event.key === "Escape" && event.target.matches("input, textarea, select")) {
    [...document.querySelectorAll(".vz .CANCEL a")].find(link => link.offsetParent)?.click();
  }
}, true);
""".replace("CANCEL", CANCEL_CLASS)
# A click that a key made has no detail: who moves by keys keeps the focus.
_ON_TAB = """
addEventListener("click", event => {
  const tab = event.detail > 0 && event.target.closest("[role=tab]");
  if (tab) setTimeout(() => tab.blur());
}, true);
"""

PAGE_KEYS = _ON_ESCAPE + _ON_TAB
"""A script that sees to it that Escape cancels from any box, and that a click on a tab does not take the keys."""
