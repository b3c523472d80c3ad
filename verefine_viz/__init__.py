"""Step through 6D pose verification and physics-guided refinement, and see why an estimate won."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Import what the library offers when it is first used: the page is heavy."""
    if name == "show":
        return import_module("verefine_viz.page.notebook").show
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
