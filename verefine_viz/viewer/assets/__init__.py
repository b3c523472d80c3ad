"""Style sheets and scripts of the page."""

from __future__ import annotations

from importlib import resources


def asset(name: str) -> str:
    """The text of a file of this folder."""
    return (resources.files(__name__) / name).read_text(encoding="utf-8")


def script_line(name: str) -> str:
    """A script of this folder in one line, for an attribute of an element."""
    lines = (line.strip() for line in asset(name).splitlines())
    return " ".join(line for line in lines if not line.startswith("//"))
