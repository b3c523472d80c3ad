"""Write the types of settings that are given as keywords of the library (make sections).

From the structs of ``verefine_viz/core/settings.py``, their docstrings, and the names of methods:
``verefine_viz/library/sections.py``, which type checkers read.
"""

from __future__ import annotations

import json
import re
import textwrap
from pathlib import Path

import msgspec.inspect as mi
from msgspec import Struct

from scripts.write_messages import parts_of
from verefine_viz.core.setting_types import descriptions, fields_of
from verefine_viz.core.settings import Session
from verefine_viz.methods.known_methods import ALL_METHOD_NAMES

SECTIONS = Path(__file__).resolve().parents[1] / "verefine_viz" / "library" / "sections.py"
WIDTH = 120
PARTS = {
    ("MethodSettings", "name"): "MethodName",
    ("MethodSettings", "refiner"): "AnyRefiner",
    ("HypothesesSettings", "source"): "AnyEstimator",
    ("ScoreSettings", "verifier"): "AnyVerifier",
    ("PhysicsSettings", "simulator"): "AnySimulator",
}
"""Fields that take more than a text, or less."""
AT_THE_FRONT = ("method", "preset")
"""Sections that ``solve`` has arguments for."""
HEAD = '''\
"""Settings by section, as keywords of the library take them. Written by `make sections` from core/settings.py."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Required, TypeAlias, TypedDict

import numpy as np
from numpy.typing import NDArray

from verefine_viz.library.plugins import AnyEstimator, AnyRefiner, AnySimulator, AnyVerifier

Whole: TypeAlias = int | np.integer[Any]
Number: TypeAlias = float | np.floating[Any] | np.integer[Any]
Numbers: TypeAlias = Sequence[Number] | NDArray[Any]
Flag: TypeAlias = bool | np.bool_
InputPath: TypeAlias = str | os.PathLike[str]
'''


def section_name(cls: type[Struct]) -> str:
    """The name of the type of a section, or of an entry of a list."""
    return cls.__name__.removesuffix("Settings") + "Section"


def written(of: mi.Type) -> str:
    """A type as Python writes it.

    Raises:
        TypeError: it has no such form.
    """
    match of:
        case mi.Metadata():
            return written(of.type)
        case mi.IntType():
            return "Whole"
        case mi.FloatType():
            return "Number"
        case mi.StrType():
            return "str" if of.pattern is None else "InputPath"
        case mi.BoolType():
            return "Flag"
        case mi.NoneType():
            return "None"
        case mi.AnyType():
            return "Any"
        case mi.LiteralType():
            return f"Literal[{', '.join(json.dumps(value) for value in of.values)}]"
        case mi.StructType():
            return section_name(of.cls)
        case mi.TupleType():
            return sequence(dict.fromkeys(map(written, of.item_types)))
        case mi.CollectionType():
            return sequence({written(of.item_type): None})
        case mi.DictType():
            return f"Mapping[str, {written(of.value_type)}]"
        case mi.UnionType():
            parts = sorted(dict.fromkeys(map(written, of.types)), key=lambda part: part == "None")
            return " | ".join(parts)
    raise TypeError(f"no type for {of}")


def sequence(items: dict[str, None]) -> str:
    """A list of some kinds of entries; of numbers an array will do."""
    return "Numbers" if [*items] == ["Number"] else f"Sequence[{' | '.join(items)}]"


def field_lines(cls: type[Struct], name: str, field: mi.Field) -> str:
    """A field of a section with its text."""
    kind = PARTS.get((cls.__name__, name)) or written(field.type)
    if field.required:
        kind = f"Required[{kind}]"
    line = f"    {name}: {kind}\n"
    if len(line) > WIDTH:
        kind = kind.removesuffix("]").replace("[", f"[\n{' ' * 8}", 1).replace('", ', f'",\n{" " * 8}')
        line = f"    {name}: {kind},\n    ]\n"
    return line + docstring(descriptions(cls).get(name, ""), "    ")


def docstring(text: str, indent: str) -> str:
    """A text as a docstring; empty without one."""
    words = re.sub(r"\s+", " ", text).strip().replace("\\", "\\\\")
    if not words:
        return ""
    lines = textwrap.wrap(f'"""{words}', WIDTH - len(indent), break_on_hyphens=False, break_long_words=False)
    end = '"""' if len(lines) == 1 and len(indent) + len(lines[0]) + 3 <= WIDTH else f'\n{indent}"""'
    return "\n".join(indent + line for line in lines) + end + "\n"


def with_parts(cls: type[Struct]) -> list[type[Struct]]:
    """A struct behind those that it is made of."""
    inner = [one for field in fields_of(cls).values() for part in parts_of(field.type) for one in with_parts(part)]
    return list(dict.fromkeys([*inner, cls]))


def declaration(name: str, base: str, text: str, lines: str) -> str:
    """A type of dicts."""
    return f"\n\nclass {name}({base}, total=False):\n{docstring(text, '    ')}\n{lines}"


def section(cls: type[Struct]) -> str:
    """The type of a section, or of an entry of a list."""
    lines = "".join(field_lines(cls, name, field) for name, field in fields_of(cls).items())
    return declaration(section_name(cls), "TypedDict", cls.__doc__ or "", lines)


def sections() -> str:
    """Return ``sections.py``."""
    names = "".join(f"    {json.dumps(name)},\n" for name in ALL_METHOD_NAMES)
    own, last = fields_of(Session), [name for name in Session.__struct_fields__ if name in AT_THE_FRONT]
    others = "".join(field_lines(Session, name, field) for name, field in own.items() if name not in last)
    front = "".join(field_lines(Session, name, own[name]) for name in last)
    return "".join(
        [
            HEAD,
            f"MethodName: TypeAlias = Literal[\n{names}]\n",
            *(section(cls) for cls in with_parts(Session) if cls is not Session),
            declaration("OtherSections", "TypedDict", "Settings beside those that `solve` has arguments for.", others),
            declaration("Sections", "OtherSections", "All settings that define a run.", front),
        ]
    )


def main() -> None:
    """Write the file."""
    SECTIONS.write_text(sections(), encoding="utf-8")


if __name__ == "__main__":
    main()
