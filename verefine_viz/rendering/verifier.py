"""Which renderer judges poses."""

from __future__ import annotations

from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import probe
from verefine_viz.rendering.gl_verifier import GlVerifier


def make_verifier(settings: ScoreSettings) -> CpuVerifier | GlVerifier:
    """The verifier that the settings ask for; ``auto`` takes OpenGL where it runs on a GPU, else the CPU rasteriser.

    Raises:
        UnavailableError: ``renderer = "gl"``, and there is no usable OpenGL.
    """
    if settings.renderer == "cpu":
        return CpuVerifier(settings)
    found = probe()
    if settings.renderer == "gl":
        if isinstance(found, UnavailableError):
            raise found
        return GlVerifier(settings)
    return CpuVerifier(settings) if isinstance(found, UnavailableError) or found.is_software else GlVerifier(settings)
