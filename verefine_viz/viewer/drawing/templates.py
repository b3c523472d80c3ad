"""HTML from the templates in ``viewer/templates``: text is escaped there, ready HTML is marked as such here."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from verefine_viz.viewer.drawing import markup


def filled(template: str, **context: Any) -> str:
    """A template with the values that it names."""
    return _environment().get_template(template).render(context)


def ready(html: str) -> Markup:
    """HTML that is not to be escaped."""
    return Markup(html)


@lru_cache(maxsize=1)
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("verefine_viz.viewer"), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.globals["swatch"] = lambda color: Markup(markup.swatch(color))
    return environment
