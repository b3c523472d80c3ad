"""The packages whose versions enter a run."""

from __future__ import annotations

import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

import verefine_viz
from verefine_viz.run import versions
from verefine_viz.run.versions import OTHER_BUILDS, package_versions

ROOT = Path(__file__).resolve().parents[2]


def test_another_build_of_a_package_is_named_and_what_is_absent_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    installed = {"pybullet-arm64": "3.2.8", "open3d": "0.20.0", "open3d-cpu": "0.19.0"}

    def version(package: str) -> str:
        if package not in installed:
            raise PackageNotFoundError(package)
        return installed[package]

    monkeypatch.setattr(versions, "version", version)
    found = package_versions.__wrapped__()
    assert found["pybullet"] == "3.2.8 (pybullet-arm64)"
    assert found["open3d"] == "0.20.0"
    assert found["numpy"] == "missing"
    assert found["verefine-viz"] == verefine_viz.__version__


def test_the_version_stands_once_and_a_foreign_build_is_one_that_was_compared() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" in project["project"]["dynamic"]
    assert "version" not in project["project"]
    needed = [line for line in project["project"]["dependencies"] if line.startswith(OTHER_BUILDS["pybullet"])]
    assert len(needed) == 1
    assert "==" in needed[0].partition(";")[0]
