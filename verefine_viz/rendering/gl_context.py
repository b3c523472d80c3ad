"""OpenGL without a window: one context per verifier, and the device that it runs on."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from functools import cache
from typing import Any

import moderngl

from verefine_viz.core.errors import UnavailableError

SOFTWARE = ("llvmpipe", "softpipe", "swiftshader", "swrast", "software", "lavapipe", "basic render")
"""Parts of the names of renderers that run on the CPU."""

WAYS: tuple[dict[str, Any], ...] = (
    {"backend": "egl", "libgl": "libGL.so.1", "libegl": "libEGL.so.1"},
    {"backend": "egl"},
    {},
)
"""How to ask for a context, in order: EGL needs no display; the platform's own way is the last resort."""

HOW_TO_GET_GL = (
    'install EGL (Debian: apt install libegl1 libgl1-mesa-dri, or the GPU\'s driver) or set score.renderer = "cpu"'
)


@dataclass(frozen=True)
class GlInfo:
    """The OpenGL of this machine."""

    renderer: str
    vendor: str
    version: str
    is_software: bool
    """Whether it runs on the CPU, where the numba rasteriser is faster."""


def create_context() -> moderngl.Context:
    """A context without a window, current in the calling thread, which is the only one that may use it.

    Raises:
        UnavailableError: there is no OpenGL 4.3.
    """
    reason = ""
    for way in WAYS:
        try:
            return moderngl.create_context(require=430, standalone=True, **way)
        except Exception as error:  # the bindings raise bare Exceptions, and each platform other ones
            reason = reason or " ".join(str(error).split())
    raise UnavailableError(f"no OpenGL 4.3 context could be made ({reason or 'unknown reason'}); {HOW_TO_GET_GL}")


def info_of(context: moderngl.Context) -> GlInfo:
    """The device that a context runs on."""
    renderer = str(context.info["GL_RENDERER"])
    return GlInfo(
        renderer=renderer,
        vendor=str(context.info["GL_VENDOR"]),
        version=str(context.info["GL_VERSION"]),
        is_software=any(name in renderer.lower() for name in SOFTWARE),
    )


@cache
def probe() -> GlInfo | UnavailableError:
    """This machine's OpenGL, or why it has none; never raises. Looked up once."""
    answers: list[GlInfo | UnavailableError] = []

    # A thread of its own, so that the caller's current context, if any, stays current.
    def look() -> None:
        try:
            context = create_context()
            answers.append(info_of(context))
            context.release()
        except UnavailableError as error:
            answers.append(error)
        except Exception as error:
            answers.append(UnavailableError(f"OpenGL failed ({error}); {HOW_TO_GET_GL}"))

    thread = threading.Thread(target=look, name="gl-probe")
    thread.start()
    thread.join()
    return answers[0] if answers else UnavailableError(f"OpenGL failed; {HOW_TO_GET_GL}")


def gl_info() -> GlInfo | None:
    """Renderer, vendor and version, or None where there is no usable OpenGL."""
    gl = probe()
    return gl if isinstance(gl, GlInfo) else None


def gl_problem() -> str | None:
    """Why there is no usable OpenGL and how to get it, in one line; None where there is."""
    gl = probe()
    return None if isinstance(gl, GlInfo) else str(gl)
