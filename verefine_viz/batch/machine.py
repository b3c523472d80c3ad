"""Which versions and which machine made a result."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import verefine_viz

PACKAGES = (
    "numpy", "scipy", "numba", "open3d", "trimesh", "pybullet", "coacd", "moderngl", "viser", "rerun-sdk", "pydantic",
)  # fmt: skip


def package_versions() -> dict[str, str]:
    """Versions of what decides about results, "missing" where one is not installed."""
    return {"verefine-viz": verefine_viz.__version__} | {name: _version(name) for name in PACKAGES}


def machine() -> dict[str, str | int]:
    """A few facts about this computer; nothing that names its owner."""
    return {
        "system": platform.platform(terse=True),
        "python": platform.python_version(),
        "cpu": _cpu_name(),
        "cores": os.cpu_count() or 1,
    }


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "missing"


def _cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
