"""What the numbers of a run depend on beside its session: Python, packages, weights."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version

from verefine_viz import __version__

PACKAGES = (
    "numpy", "numba", "scipy", "pybullet", "open3d", "coacd", "trimesh", "onnxruntime", "moderngl", "viser",
    "rerun-sdk",
)  # fmt: skip
OTHER_BUILDS = {"pybullet": "pybullet-arm64", "open3d": "open3d-cpu"}
"""Other builds of a package's code, with module names of the same; docs/decisions/other-builds.md."""


def versions(weights: Mapping[str, str]) -> dict[str, str]:
    """Python, the packages and the weights whose numbers enter a run.

    Args:
        weights: hashes of the run's weights by name, as :func:`verefine_viz.run.session_parts.weights_of` has them.
    """
    of_python = {"python": platform.python_version(), "machine": platform.machine()}
    return of_python | package_versions() | dict(weights)


@cache
def package_versions() -> dict[str, str]:
    """Versions of the packages that a run may use, "missing" where one is not installed; another build is named."""
    return {"verefine-viz": __version__} | {package: _version(package) for package in PACKAGES}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        pass
    other = OTHER_BUILDS.get(package, "")
    try:
        return f"{version(other)} ({other})" if other else "missing"
    except PackageNotFoundError:
        return "missing"
