"""Looking into a report's file."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

GONE = {"title": "Gone", "scene": {"source": "bop", "dataset": "/nowhere/at/all"}}
"""A session whose data set is not there any more."""


def messages(path: Path) -> dict[str, Any]:
    """The messages of a report by their type."""
    text = re.search(
        r'<script type="application/json" id="messages">(.*?)</script>', path.read_text("utf-8"), re.DOTALL
    )
    assert text is not None
    return {message["t"]: message for message in json.loads(text[1])}


def report(path: Path) -> dict[str, Any]:
    return messages(path)["report"]


def section(path: Path) -> dict[str, Any]:
    """The only section."""
    (only,) = report(path)["sections"]
    return only


def parts(path: Path, kind: str) -> list[str]:
    """The names of parts of the file: "/thumb/" for small pictures, "part " for frames."""
    return re.findall(rf'<script type="text/plain" id="{kind}([^"]+)">', path.read_text("utf-8"))
