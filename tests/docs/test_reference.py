"""The reference has every name of the library, and every name has a docstring with its arguments."""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from pathlib import Path

import pytest

import verefine_viz as vv
from verefine_viz import _HOMES

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
ENTRIES = re.findall(r"^::: ([\w.]+)$", REFERENCE, re.MULTILINE)
CALLS = sorted(name for name in _HOMES if inspect.isfunction(getattr(vv, name)))
CLASSES = (vv.Frame, vv.OpenedFrame, vv.Run, vv.Batch, vv.Trace)


def test_it_has_every_name_of_the_library_once() -> None:
    assert len(ENTRIES) == len(set(ENTRIES))
    # Two calls are named as packages are, and go by the module that they are in.
    packages = {name for name in _HOMES if (ROOT / "verefine_viz" / name).is_dir()}
    assert packages == {"batch", "report"}
    names = {f"{_HOMES[name]}.{name}" if name in packages else name for name in _HOMES}
    assert {f"verefine_viz.{name}" for name in names} <= {*ENTRIES}


@pytest.mark.parametrize("entry", ENTRIES)
def test_what_it_names_exists_and_is_described(entry: str) -> None:
    module, _, name = entry.rpartition(".")
    assert inspect.getdoc(getattr(import_module(module), name))


def described(call: object) -> tuple[set[str], set[str]]:
    """The arguments of a call, and those that its docstring describes."""
    text = inspect.getdoc(call) or ""
    section = re.search(r"^Args:\n((?:    .*\n?|\n)+)", text, re.MULTILINE)
    written = set(re.findall(r"^    (\w+):", section[1], re.MULTILINE)) if section else set()
    return {name for name in inspect.signature(call).parameters if name != "self"}, written  # type: ignore[arg-type]


def test_every_argument_is_described_and_no_other() -> None:
    methods = [m for kind in CLASSES for name, m in inspect.getmembers(kind, inspect.isfunction) if name[0] != "_"]
    calls = [getattr(vv, name) for name in CALLS] + [m for m in methods if m.__name__ != "tools"]
    assert len(calls) > 20
    for call in calls:
        arguments, written = described(call)
        if written or call.__name__ in CALLS:
            assert arguments == written, call
