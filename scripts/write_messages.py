"""Write what the page and its server say to each other (make messages).

From the structs of ``verefine_viz/page/messages.py`` and ``protocol.py`` and their docstrings: the declarations
``verefine_viz/page/web/messages.d.ts``, and the tables of ``docs/page.md``.
"""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import msgspec.inspect as mi
from msgspec import NODEFAULT, Struct

from verefine_viz.core.setting_types import descriptions, fields_of
from verefine_viz.page import protocol
from verefine_viz.page.answers_to_wants import AnyAnswer
from verefine_viz.page.messages import AnyMessage
from verefine_viz.page.protocol import AnyVerb, AnyWant

ROOT = Path(__file__).resolve().parents[1]
DECLARATIONS = ROOT / "verefine_viz" / "page" / "web" / "messages.d.ts"
PAGE = ROOT / "docs" / "page.md"
UNIONS = {"AnyMessage": AnyMessage, "AnyAnswer": AnyAnswer, "AnyVerb": AnyVerb, "AnyWant": AnyWant}
"""What goes down, what wants are answered with, what comes up, and what is wanted."""
NUMBERS_OF_POSE = 16
HEAD = """\
// Written by `make messages` from verefine_viz/page/messages.py and protocol.py: change those.

/** T_cam_obj, 16 numbers by rows [m]. */
export type Pose = number[];
"""


# Types as TypeScript writes them


def written(of: mi.Type) -> str:
    """Return a type in TypeScript.

    Raises:
        TypeError: it has no such form.
    """
    match of:
        case mi.Metadata():
            return written(of.type)
        case mi.IntType() | mi.FloatType():
            return "number"
        case mi.StrType():
            return "string"
        case mi.BoolType():
            return "boolean"
        case mi.NoneType():
            return "null"
        case mi.AnyType():
            return "unknown"
        case mi.LiteralType():
            return " | ".join(json.dumps(value) for value in of.values)
        case mi.StructType():
            return of.cls.__name__
        case mi.TupleType():
            return f"[{', '.join(map(written, of.item_types))}]"
        case mi.DictType():
            return f"Record<string, {written(of.value_type)}>"
        case mi.CollectionType():
            return written_list(of)
        case mi.UnionType():
            return written_union(of)
    raise TypeError(f"no TypeScript for {of}")


def written_list(of: mi.CollectionType) -> str:
    """Return a list in TypeScript; one of 16 numbers is a pose."""
    item = written(of.item_type)
    if item == "number" and of.min_length == of.max_length == NUMBERS_OF_POSE:
        return "Pose"
    return f"({item})[]" if " | " in item else f"{item}[]"


def written_union(of: mi.UnionType) -> str:
    """Return a union in TypeScript: by its name where it has one, null last."""
    structs = {kind.cls for kind in of.types if isinstance(kind, mi.StructType)}
    rest = [kind for kind in of.types if not isinstance(kind, mi.StructType | mi.NoneType)]
    name = next((name for name, union in UNIONS.items() if structs == {*get_args(union)}), None)
    parts = [name] if name is not None else [kind.__name__ for kind in sorted(structs, key=lambda kind: kind.__name__)]
    parts += map(written, rest)
    parts += ["null"] if any(isinstance(kind, mi.NoneType) for kind in of.types) else []
    return " | ".join(dict.fromkeys(parts))


def is_optional(cls: type[Struct], field: mi.Field) -> bool:
    """Return whether a key may be missing: in what comes up one with a default, in what goes down one that is unset."""
    has_default = field.default is not NODEFAULT or field.default_factory is not NODEFAULT
    return not field.required and (cls.__module__ == protocol.__name__ or not has_default)


# The structs that a union is made of


def parts_of(of: mi.Type) -> Iterator[type[Struct]]:
    """Return the structs that a type names."""
    match of:
        case mi.StructType():
            yield of.cls
        case mi.Metadata():
            yield from parts_of(of.type)
        case mi.CollectionType():
            yield from parts_of(of.item_type)
        case mi.DictType():
            yield from parts_of(of.value_type)
        case mi.TupleType():
            for item in of.item_types:
                yield from parts_of(item)
        case mi.UnionType():
            for kind in of.types:
                yield from parts_of(kind)


def with_parts(cls: type[Struct], known: dict[type[Struct], None]) -> list[type[Struct]]:
    """Return a struct and those it is made of, as far as they are not among the ``known``, which they join."""
    if cls in known:
        return []
    known[cls] = None
    parts = [part for field in fields_of(cls).values() for part in parts_of(field.type)]
    return [cls, *(one for part in parts for one in with_parts(part, known))]


# messages.d.ts


def comment(text: str, indent: str = "") -> str:
    """Return a comment in front of a declaration; "" without a text."""
    lines = plain(text).splitlines()
    if len(lines) < 2:
        return "".join(f"{indent}/** {line} */\n" for line in lines)
    return "".join([f"{indent}/**\n", *(f"{indent} * {line}".rstrip() + "\n" for line in lines), f"{indent} */\n"])


def plain(text: str | None) -> str:
    """Return a docstring without its indentation, with code in single backticks."""
    return inspect.cleandoc(text or "").replace("``", "`")


def declaration(cls: type[Struct]) -> str:
    """Return the declaration of a struct."""
    fields, texts, config = fields_of(cls), descriptions(cls), cls.__struct_config__
    if config.array_like:
        items = ", ".join(f"{field.encode_name}: {written(field.type)}" for field in fields.values())
        return f"{comment(cls.__doc__ or '')}export type {cls.__name__} = [{items}];\n"
    lines = [f"  {config.tag_field}: {json.dumps(config.tag)};\n"] if config.tag_field else []
    for name, field in fields.items():
        mark = "?" if is_optional(cls, field) else ""
        lines.append(f"{comment(texts.get(name, ''), '  ')}  {field.encode_name}{mark}: {written(field.type)};\n")
    return f"{comment(cls.__doc__ or '')}export interface {cls.__name__} {{\n{''.join(lines)}}}\n"


def declarations() -> str:
    """Return ``messages.d.ts``.

    Raises:
        ValueError: two structs have one name.
    """
    known: dict[type[Struct], None] = {}
    blocks = [HEAD]
    for name, union in UNIONS.items():
        members = get_args(union)
        blocks.append(
            f"export type {name} =\n{''.join(f'  | {cls.__name__}{chr(10)}' for cls in members)}".rstrip() + ";\n"
        )
        blocks += [declaration(one) for cls in members for one in with_parts(cls, known)]
    names = [cls.__name__ for cls in known]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"two structs are called {', '.join(twice)}")
    return "\n".join(blocks)


# docs/page.md


def cell(text: str) -> str:
    """Return a text as the cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


def table(union: Any, first: str, known: dict[type[Struct], None]) -> str:
    """Return a table with a row for each member of a union, by its tag, and for each of their parts, by its name."""
    rows = [f"| {first} | keys | what |\n|---|---|---|\n"]
    for cls in (one for member in get_args(union) for one in with_parts(member, known)):
        texts, fields = descriptions(cls), fields_of(cls)
        keys = [
            f"`{field.encode_name}{'?' if is_optional(cls, field) else ''}: {cell(written(field.type))}`"
            for field in fields.values()
        ]
        what = [plain(cls.__doc__), *(f"`{fields[name].encode_name}`: {plain(texts[name])}" for name in texts)]
        name = cls.__struct_config__.tag
        rows.append(
            f"| {f'**`{name}`**' if name else f'`{cls.__name__}`'} | {', '.join(keys)} | {cell(' '.join(what))} |\n"
        )
    return "".join(rows)


def page(text: str) -> str:
    """Return ``docs/page.md`` with its tables replaced; the rest stays."""
    known: dict[type[Struct], None] = {}
    parts = {"want": AnyWant, "verb": AnyVerb, "message": AnyMessage}  # Each names parts of those before it.
    for name, union in parts.items():
        between = re.compile(rf"(<!-- {name}s: make messages -->\n).*?(<!-- end of {name}s -->)", re.DOTALL)
        rows = table(union, name, known)
        text = between.sub(lambda match, rows=rows: f"{match[1]}\n{rows}\n{match[2]}", text, count=1)
    return text


def main() -> None:
    """Write both files."""
    DECLARATIONS.write_text(declarations(), encoding="utf-8")
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
