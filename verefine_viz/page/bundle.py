"""The page as one HTML file: its modules and styles, with messages, answers and arrays in place of a server."""

from __future__ import annotations

import base64
import gzip
import io
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from PIL import Image

from verefine_viz.page.answers_to_wants import AnyAnswer
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.messages import AnyMessage
from verefine_viz.page.protocol import encoded
from verefine_viz.page.web_files import IMPORT_MAP, WEB, libraries

CSP = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src data: blob:; worker-src data: blob:; frame-src blob:"
)
"""Everything is in the file: nothing may be loaded from elsewhere."""
_IMPORTED = re.compile(r"""(\bfrom\s+|\bimport\s+|\bimport\()"(\.{1,2}/[^"]+)\"""")
_STYLE = re.compile(r'<link rel="stylesheet" href="/web/([^"]+)">')
_FIRST_SCRIPT = re.compile(r'<script src="/web/([^"]+)"></script>')
_SCRIPT = re.compile(r'<script type="module" src="/web/([^"]+)"></script>')

AskedFor = tuple[dict[str, Any], AnyAnswer]
"""A want, as a browser sends it, and its answer."""


class InlinedBlobs(Blobs):
    """Arrays and pictures of a file; a server would hold them only for a while.

    Args:
        prefix: beginning of every key, different for each part of a file that has blobs of its own.
    """

    def __init__(self, prefix: str = "") -> None:
        super().__init__()
        self._prefix = prefix
        self.elements: list[str] = []
        """What the file holds, as HTML."""

    def put(self, data: bytes, media_type: str = "application/octet-stream") -> str:
        """Hold bytes and return their key."""
        key = f"{self._prefix}{len(self.elements) + 1}"
        if media_type.startswith("image/"):
            self.elements.append(picture(f"/blob/{key}", data, media_type))
        else:
            self.elements.append(element(f"blob {key}", "text/plain", compressed(data)))
        return key


def bundle(
    messages: Iterable[AnyMessage],
    answers: Iterable[AskedFor] = (),
    elements: Iterable[str] = (),
    title: str = "verefine-viz",
) -> str:
    """Return the page as one HTML document that needs no server and loads nothing.

    Args:
        messages: what a server would send, see docs/page.md.
        answers: wants and what answers them.
        elements: HTML of blobs, pictures and further parts, see :func:`element`.
        title: of the window.
    """
    page = (WEB / "index.html").read_text("utf-8")
    page = _STYLE.sub(lambda m: f"<style>{(WEB / m[1]).read_text('utf-8')}</style>", page)
    page = _FIRST_SCRIPT.sub(lambda m: f"<script>{(WEB / m[1]).read_text('utf-8')}</script>", page)
    page = re.sub(r"<title>.*?</title>", lambda m: f"<title>{_escaped(title)}</title>", page)
    policy = f'<meta http-equiv="Content-Security-Policy" content="{CSP}">'
    page = page.replace('<meta charset="utf-8">', f'<meta charset="utf-8">\n    {policy}', 1)
    own = {_name(path): path for path in sorted(WEB.rglob("*.js")) if path.parent.name != "vendor"}
    imports = {name: _address(path) for name, path in {**libraries(), **own}.items()}
    page = IMPORT_MAP.sub(lambda m: f'<script type="importmap">{json.dumps({"imports": imports})}</script>', page)
    page = _SCRIPT.sub(lambda m: f'<script type="module">import "web/{m[1]}";</script>', page)
    parts = "\n".join((*elements, part("page", messages, answers)))
    return page.replace("</body>", f"{parts}\n</body>")


def element(name: str, media_type: str, text: str) -> str:
    """Return a part of the document that is not shown; ``text`` holds no markup."""
    return f'<script type="{media_type}" id="{_escaped(name)}">{text}</script>'


def part(name: str, messages: Iterable[AnyMessage], answers: Iterable[AskedFor]) -> str:
    """Return what a server would send, and wants with what answers them, as a part of the document."""
    content = {"messages": list(messages), "answers": list(answers)}
    return element(name, "text/plain", compressed(encoded(content)))


def picture(path: str, data: bytes, media_type: str) -> str:
    """Return a picture as a part of the document; ``path`` is where a server would have it."""
    if media_type == "image/png":
        data, media_type = webp(data, lossless=True, exact=True), "image/webp"
    return element(path, "text/plain", f"data:{media_type};base64,{base64.b64encode(data).decode()}")


def webp(data: bytes, **how: Any) -> bytes:
    """Return a picture as WebP, which takes less room."""
    out = io.BytesIO()
    with Image.open(io.BytesIO(data)) as image:
        image.save(out, "webp", **how)
    return out.getvalue()


def compressed(data: bytes) -> str:
    """Return bytes as text, the same for the same bytes."""
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode()


def _name(path: Path) -> str:
    """Return the name under which a file imports a module of the page."""
    return f"web/{path.resolve().relative_to(WEB.resolve()).as_posix()}"


def _address(path: Path) -> str:
    """Return a module as an address; its imports are named from the top, as such an address has no folder."""
    source = _IMPORTED.sub(lambda m: f'{m[1]}"{_name(path.parent / m[2])}"', path.read_text("utf-8"))
    return f"data:text/javascript;base64,{base64.b64encode(source.encode()).decode()}"


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")


def command_path(path: Path) -> str:
    """Return a path for a command that is shown: as it is, or of an absolute one the last part."""
    return path.name if path.is_absolute() else str(path)
