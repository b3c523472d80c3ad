"""What the page does itself about keys where the library ignores them; nothing of it reaches Python.

The library leaves keys alone in boxes for text, and its tabs keep Space for themselves after a click on them.
"""

from __future__ import annotations

import math

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

# The library moves by the time since the last picture, which may be seconds: a tap threw the camera out of the scene.
# It listens on the document as well, but later; what handles keys inside of the page has had them by then.
_ON_CAMERA_KEY = """
{
  const moves = {
    KeyA: (camera, step) => camera.truck(-step, 0, false),
    KeyD: (camera, step) => camera.truck(step, 0, false),
    KeyW: (camera, step) => camera.dolly(step, false),
    KeyS: (camera, step) => camera.dolly(-step, false),
    KeyQ: (camera, step) => camera.elevate(-step, false),
    KeyE: (camera, step) => camera.elevate(step, false),
    ArrowLeft: camera => camera.rotate(-TURN, 0, false),
    ArrowRight: camera => camera.rotate(TURN, 0, false),
    ArrowUp: camera => camera.rotate(0, -TURN, false),
    ArrowDown: camera => camera.rotate(0, TURN, false),
  };
  document.addEventListener("keydown", event => {
    const camera = window.__viserMutable?.cameraControl;
    if (!moves[event.code] || !camera || event.target.matches("input, textarea, select")) return;
    event.stopImmediatePropagation();
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || !camera.enabled) return;
    moves[event.code](camera, SHARE * camera.distance);
  });
}
""".replace("TURN", f"{math.radians(4):.4f}").replace("SHARE", "0.04")
"""A press moves by a share of the distance from what is looked at, or turns by some degrees; held, it repeats."""

PAGE_KEYS = _ON_ESCAPE + _ON_TAB + _ON_CAMERA_KEY
"""A script for the keys: Escape cancels from any box, a click on a tab does not take them, the camera moves evenly."""
