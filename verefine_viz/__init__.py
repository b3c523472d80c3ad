"""Step through 6D pose verification and physics-guided refinement, and see why an estimate won."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from verefine_viz.page.notebook import show as show

__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    """Import what the library offers when it is first used: the page is heavy."""
    if name == "show":
        from verefine_viz.page.notebook import show

        return show
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
