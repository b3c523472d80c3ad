"""Step through 6D pose verification and physics-guided refinement, and see why an estimate won."""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"


def show(what: Any, height: int = 800) -> Any:
    """Show a run, or what lies at a path, within a notebook; see ``verefine_viz.page.notebook.show``."""
    # The page is heavy, and stands above everything that imports the version from here.
    return import_module("verefine_viz.page.notebook").show(what, height)


def share(what: Any, out: Any, frame: str | None = None, maps: Any = "marked", with_scene: bool = True) -> str:
    """Write a run as one HTML file that opens without this program; see ``verefine_viz.page.share.share``."""
    return import_module("verefine_viz.page.share").share(what, out, frame, maps, with_scene)
