"""The words of CONTRIBUTING.md, "Words": names and texts use the field's terms."""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

from verefine_viz.run.session_file import CAPTURE_HEAD

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = sorted((ROOT / "verefine_viz").rglob("*.py"))
LIST = (ROOT / "CONTRIBUTING.md").read_text("utf-8").partition("`tests/docs/test_words.py` refuses")[2]
REFUSED = re.findall(r"`([a-z ]+)`", LIST)


def names_in(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of all that is defined or assigned, as words."""
    for node in ast.walk(tree):
        match node:
            case ast.FunctionDef() | ast.ClassDef():
                yield node.lineno, node.name.replace("_", " ")
            case ast.arg():
                yield node.lineno, node.arg.replace("_", " ")
            case ast.Name(ctx=ast.Store()):
                yield node.lineno, node.id.replace("_", " ")
            case _:
                pass


def texts_in(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of comments and strings, but for the line by which folders of captured frames are recognised."""
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in (tokenize.COMMENT, tokenize.STRING):
            yield token.start[0], token.string.replace(CAPTURE_HEAD.removesuffix("\n"), "")


def test_names_and_texts_of_the_product_use_the_fields_words() -> None:
    assert len(REFUSED) > 3
    refused, hits = re.compile(rf"\b({'|'.join(REFUSED)})\b", re.IGNORECASE), list[str]()
    for path in PRODUCT:
        source = path.read_text(encoding="utf-8")
        for line, words in [*names_in(ast.parse(source)), *texts_in(source)]:
            hits += [f"{path.relative_to(ROOT)}:{line}: {hit.group()}" for hit in refused.finditer(words)]
    assert hits == []


def test_module_names_are_unique() -> None:
    """A name that occurs twice would mean two things. Each registry is its package's table of what plugs in."""
    names = [path.name for path in PRODUCT if path.name not in ("__init__.py", "registry.py")]
    assert sorted({name for name in names if names.count(name) > 1}) == []
