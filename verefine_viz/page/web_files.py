"""The browser's part of the page as files: where they are, and the libraries that its modules import by name."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from pathlib import Path

WEB = Path(__file__).parent / "web"
IMPORT_MAP = re.compile(r'<script type="importmap">(.*?)</script>', re.DOTALL)
"""The part of ``index.html`` that says which file a library is."""


def demo_picture(name: str) -> Path:
    """Return the file of the small picture of a built-in scene, which may be missing."""
    return WEB / "demos" / f"{name}.webp"


def libraries() -> dict[str, Path]:
    """Return the files of libraries by the names under which modules import them."""
    imports = json.loads(_import_map())["imports"]
    return {name: WEB / address.removeprefix("/web/") for name, address in imports.items()}


def import_map_hash() -> str:
    """Return the hash by which a Content-Security-Policy admits the import map of ``index.html``."""
    return f"sha256-{base64.b64encode(hashlib.sha256(_import_map().encode()).digest()).decode()}"


def _import_map() -> str:
    match = IMPORT_MAP.search((WEB / "index.html").read_text("utf-8"))
    assert match is not None
    return match[1]
