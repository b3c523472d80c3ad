"""messages.d.ts and docs/page.md are what ``make messages`` writes from the structs of the page."""

from __future__ import annotations

from typing import get_args

from scripts.write_messages import DECLARATIONS, PAGE, declarations, page
from verefine_viz.page.messages import AnyMessage
from verefine_viz.page.protocol import AnyVerb, AnyWant


def test_the_declarations_are_those_of_the_structs() -> None:
    """Where this fails: ``make messages``."""
    assert DECLARATIONS.read_text("utf-8") == declarations()


def test_the_page_has_the_tables_of_the_structs() -> None:
    """Where this fails: ``make messages``."""
    text = PAGE.read_text("utf-8")
    assert page(text) == text
    for union in (AnyMessage, AnyVerb, AnyWant):
        for cls in get_args(union):
            assert text.count(f"\n| **`{cls.__struct_config__.tag}`** |") >= 1, cls
