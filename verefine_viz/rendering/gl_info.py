"""What OpenGL this machine has, for people."""

from __future__ import annotations

from verefine_viz.rendering.gl_context import GlInfo, probe

__all__ = ["GlInfo", "gl_info", "gl_problem"]


def gl_info() -> GlInfo | None:
    """Renderer, vendor and version, or None where there is no usable OpenGL; never raises. Looked up once."""
    found = probe()
    return found if isinstance(found, GlInfo) else None


def gl_problem() -> str | None:
    """Why there is no usable OpenGL and how to get it, in one line; None where there is."""
    found = probe()
    return None if isinstance(found, GlInfo) else str(found)
