"""viser's page, with a script of ours before viser's own and a policy on what may run in it.

viser has no option to hide its panel and its notifications: ``before_viser.js`` does. The page around it reads three
private parts of viser's client in the browser: the number of pictures drawn, which nodes there are (``web/scene.js``),
and the camera, which is held still during a press beside a handle (``web/gizmo_guard.js``). Written for viser 1.1.1;
``tests/browser/test_scene_pane.py`` fails if they change.
"""

from __future__ import annotations

import base64
import hashlib
import re
import secrets
from functools import cache
from pathlib import Path

import viser

from verefine_viz.rendering.gl_context import SOFTWARE

_NONCE = secrets.token_urlsafe(16)
_BEFORE = (
    (Path(__file__).parent / "before_viser.js")
    .read_text(encoding="utf-8")
    .replace("NONCE", _NONCE)
    .replace("SOFTWARE_RENDERERS", "|".join(SOFTWARE))
)
_VISERS_OWN = Path(viser.__file__).parent / "client" / "build" / "index.html"
"""The only file of viser's client."""


@cache
def served() -> tuple[str, str]:
    """Return the page that browsers load, and its Content-Security-Policy."""
    page = _with_script(_VISERS_OWN.read_text(encoding="utf-8"), _BEFORE)
    return page, _policy(page)


def exported(page: str) -> str:
    """Return a page that viser exported, with our script before viser's own; the same input gives the same page."""
    return _with_script(page, _BEFORE.replace(_NONCE, ""))


def _with_script(page: str, script: str) -> str:
    return page.replace("<head>", f"<head><script>{script}</script>", 1)


def _policy(page: str) -> str:
    """Allow the page's own scripts, the one that they insert, WebAssembly and workers; all of it is served by us."""
    scripts = re.findall(r"<script[^>]*>(.*?)</script>", page, re.DOTALL)
    hashes = [f"'sha256-{base64.b64encode(hashlib.sha256(one.encode()).digest()).decode()}'" for one in scripts]
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(hashes)} 'nonce-{_NONCE}' 'wasm-unsafe-eval'",
            "worker-src blob:",
            "style-src 'unsafe-inline'",
            "img-src data: blob:",
            "font-src data:",
            "connect-src 'self' data: blob:",  # blob: textures of models
            "base-uri 'none'",
            "form-action 'none'",
            # Framed by our page, which a notebook on this machine may frame in turn.
            "frame-ancestors 'self' http://localhost:* http://127.0.0.1:*",
        ]
    )
