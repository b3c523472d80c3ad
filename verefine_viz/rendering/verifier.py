"""Which renderer judges poses."""

from __future__ import annotations

from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import ScoreSettings
from verefine_viz.rendering.cpu_verifier import CpuVerifier
from verefine_viz.rendering.gl_context import probe
from verefine_viz.rendering.gl_verifier import GlVerifier


def make_verifier(settings: ScoreSettings, progress: ProgressToken = NEVER_CANCELLED) -> CpuVerifier | GlVerifier:
    """The verifier that the settings ask for; ``auto`` takes OpenGL where it runs on a GPU, else the CPU rasteriser.

    Args:
        settings: of the score.
        progress: asked where the mesh of a model has to be made.

    Raises:
        UnavailableError: ``renderer = "gl"``, and there is no usable OpenGL.
    """
    if settings.renderer == "cpu":
        return CpuVerifier(settings, progress=progress)
    found = probe()
    if settings.renderer == "gl":
        if isinstance(found, UnavailableError):
            raise found
        return GlVerifier(settings, progress=progress)
    is_usable = not isinstance(found, UnavailableError) and not found.is_software
    return GlVerifier(settings, progress=progress) if is_usable else CpuVerifier(settings, progress=progress)
