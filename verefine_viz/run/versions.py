"""What the numbers of a run depend on beside its session: Python, packages, weights."""

from __future__ import annotations

import platform
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from verefine_viz.core.settings import Session
from verefine_viz.run.session_parts import weights_of

BULLET = "pybullet" if sys.version_info < (3, 12) else "pybullet-arm64"
"""The package that brings the module pybullet (pyproject.toml)."""
PACKAGES = (
    "verefine-viz", "numpy", "numba", "scipy", BULLET, "open3d", "coacd", "trimesh", "onnxruntime", "moderngl", "viser",
    "rerun-sdk",
)  # fmt: skip


def versions(session: Session) -> dict[str, str]:
    """Python, the packages and the weights whose numbers enter a run of the session."""
    return (
        {"python": platform.python_version(), "machine": platform.machine()} | package_versions() | weights_of(session)
    )


@cache
def package_versions() -> dict[str, str]:
    """Versions of the packages that a run may use, "missing" where one is not installed."""
    return {package: _version(package) for package in PACKAGES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
