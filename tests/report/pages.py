"""Looking into a report's file."""

from __future__ import annotations

import base64
import gzip
import json
import re
from pathlib import Path
from typing import Any

GONE = {"title": "Gone", "scene": {"source": "bop", "dataset": "/nowhere/at/all"}}
"""A session whose data set is not there any more."""


def messages(path: Path) -> dict[str, Any]:
    """The messages of a report by their type."""
    text = re.search(r'<script type="text/plain" id="page">(.*?)</script>', path.read_text("utf-8"))
    assert text is not None
    content = json.loads(gzip.decompress(base64.b64decode(text[1])))
    return {message["t"]: message for message in content["messages"]}


def report(path: Path) -> dict[str, Any]:
    return messages(path)["report"]


def section(path: Path) -> dict[str, Any]:
    """The only section."""
    (only,) = report(path)["sections"]
    return only


def parts(path: Path, kind: str) -> list[str]:
    """The names of parts of the file: "/thumb/" for small pictures, "part " for frames."""
    return re.findall(rf'<script type="text/plain" id="{kind}([^"]+)">', path.read_text("utf-8"))
