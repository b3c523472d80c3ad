"""What runs in the browser before viser's page does, and what may run there: that page has no settings for either."""

from __future__ import annotations

import base64
import gzip
import hashlib
import http
import re
import secrets
from functools import lru_cache

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from verefine_viz.rendering.gl_context import SOFTWARE
from verefine_viz.viewer.admission import Answer
from verefine_viz.viewer.markup import HANDLERS
from verefine_viz.viewer.page_keys import PAGE_KEYS

_NONCE = secrets.token_urlsafe(16)
# viser's page unpacks its program and puts it into one script element; nothing else that is written into the page runs.
_OF_POLICY = """
document.createElement = function (name, options) {
  const made = Document.prototype.createElement.call(this, name, options);
  if (name === "script") {
    made.nonce = "NONCE";
    delete document.createElement;
  }
  return made;
};
// The library's sorter of Gaussian splats, of which we have none, wants to evaluate text as a program, and may not.
addEventListener("unhandledrejection", event => {
  if (event.reason instanceof EvalError) event.preventDefault();
});
""".replace("NONCE", _NONCE)

_WITHOUT_GPU = """
{
  const probe = document.createElement("canvas").getContext("webgl2");
  const names = probe?.getExtension("WEBGL_debug_renderer_info");
  const renderer = probe?.getParameter(names ? names.UNMASKED_RENDERER_WEBGL : probe.RENDERER) ?? "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  if (/SOFTWARE/i.test(renderer)) {
    const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return get.call(this, kind, kind.startsWith("webgl") ? {...options, antialias: false} : options);
    };
    // viser would go over to fewer pixels by itself after some slow pictures, and seldom come back.
    const held = setInterval(() => {
      const settings = window.__viserTestpoints?.devSettings;
      if (!settings) return;
      clearInterval(held);
      if (settings.get().fixedDpr === null) settings.set({fixedDpr: window.devicePixelRatio});
    }, 500);
  }
}
""".replace("SOFTWARE", "|".join(SOFTWARE))
"""Without a GPU smooth edges take a third of the time of every picture, and a step waits for it."""


def with_script(answer: Answer) -> Answer:
    """Serves the page with our script at its very beginning and a policy of what may run; everything else as it was."""

    def answer_with_script(connection: ServerConnection, request: Request) -> Response | None:
        response = answer(connection, request)
        if response is None or response.status_code != http.HTTPStatus.OK:
            return response
        if not response.headers.get("Content-Type", "").startswith("text/html"):
            return response
        is_packed = response.headers.get("Content-Encoding") == "gzip"
        response.body, response.headers["Content-Security-Policy"] = _with_script(
            bytes(response.body or b""), is_packed
        )
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))
        return response

    return answer_with_script


@lru_cache(maxsize=4)
def _with_script(page: bytes, is_packed: bool) -> tuple[bytes, str]:
    """The page with our script, and its policy."""
    page = gzip.decompress(page) if is_packed else page
    script = f"<head><script>{_OF_POLICY}{_WITHOUT_GPU}{HANDLERS}{PAGE_KEYS}</script>"
    page = page.replace(b"<head>", script.encode(), 1)
    return gzip.compress(page) if is_packed else page, _policy(page)


def _policy(page: bytes) -> str:
    """The scripts that stand in a page, the one they insert, WebAssembly and workers; styles, and pictures sent by us.

    Nothing is fetched from elsewhere, and no page may show this one within itself.
    """
    scripts = re.findall(rb"<script[^>]*>(.*?)</script>", page, re.DOTALL)
    hashes = [f"'sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}'" for script in scripts]
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(hashes)} 'nonce-{_NONCE}' 'wasm-unsafe-eval'",
            "worker-src blob:",
            "style-src 'unsafe-inline'",
            "img-src data: blob:",
            "connect-src 'self' data:",
            "base-uri 'none'",
            "form-action 'none'",
            "frame-ancestors 'none'",
        ]
    )
