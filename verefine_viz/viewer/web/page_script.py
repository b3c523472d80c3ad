"""What runs in the browser before viser's page does: that page has no settings of its own for it."""

from __future__ import annotations

import gzip
import http
from collections.abc import Callable
from functools import lru_cache

from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from verefine_viz.rendering.gl_context import SOFTWARE
from verefine_viz.viewer.web.viser_internals import PAGE_SCRIPT as PAGE_KEYS

Answer = Callable[[ServerConnection, Request], Response | None]
"""What a web server answers to a request; None = nothing, it opens a websocket."""

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
    """Serves the page with our script at its very beginning; everything else as it was."""

    def answer_with_script(connection: ServerConnection, request: Request) -> Response | None:
        response = answer(connection, request)
        if response is None or response.status_code != http.HTTPStatus.OK:
            return response
        if not response.headers.get("Content-Type", "").startswith("text/html"):
            return response
        response.body = _with_script(bytes(response.body or b""), response.headers.get("Content-Encoding") == "gzip")
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(response.body))
        return response

    return answer_with_script


@lru_cache(maxsize=4)
def _with_script(page: bytes, is_packed: bool) -> bytes:
    page = gzip.decompress(page) if is_packed else page
    page = page.replace(b"<head>", f"<head><script>{_WITHOUT_GPU}{PAGE_KEYS}</script>".encode(), 1)
    return gzip.compress(page) if is_packed else page
