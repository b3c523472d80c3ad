"""The wheel: installed into an environment of its own, the program works in an empty folder."""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Callable
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]

Call = Callable[..., subprocess.CompletedProcess[str]]

KERNEL_CALL = """
import numpy as np
from verefine_viz.core.kernels import cache_folder
from verefine_viz.refiners.nearest import NearestIndex, mean_distance
print(mean_distance(np.array([[1.0, 0.0, 0.0]]), np.eye(4), NearestIndex.build(np.zeros((1, 3)))), cache_folder())
"""


@pytest.fixture(scope="module")
def empty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which programs are called."""
    return tmp_path_factory.mktemp("empty")


@pytest.fixture(scope="module")
def kernels(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which compiled functions are cached."""
    return tmp_path_factory.mktemp("kernels")


@pytest.fixture(scope="module")
def call(processes: None, empty: Path, kernels: Path, tmp_path_factory: pytest.TempPathFactory) -> Call:
    """Calls a program in an empty folder, of an environment in which the wheel was installed over an older version that
    had been used; other packages are those of the tests' environment.
    """
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=REPOSITORY, check=True, capture_output=True, timeout=300)
    (wheel,) = folder.glob("verefine_viz-*.whl")
    venv.create(folder / "venv", with_pip=False)
    bin_folder = folder / "venv" / "bin"
    # Copies: links would lead into the cache of uv, and the older version is made by writing into files.
    install = [
        *(sys.executable, "-m", "uv", "pip", "install", "--offline", "--no-deps", "--reinstall", "--link-mode", "copy"),
        *("--python", str(bin_folder / "python"), str(wheel)),
    ]
    subprocess.run(install, check=True, capture_output=True, timeout=300)
    # Searched last, and .pth files in it are not followed: the repository is not on the path.
    site = next((folder / "venv" / "lib").glob("python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def called(program: str, *given: str) -> subprocess.CompletedProcess[str]:
        command = [str(bin_folder / program), *given]
        own = env | {"NUMBA_CACHE_DIR": str(kernels)}
        return subprocess.run(command, cwd=empty, env=own, capture_output=True, text=True, timeout=300)

    for source in (site / "verefine_viz").rglob("*.py"):
        text = re.sub(r"\bNearestIndex\b", "OlderIndex", source.read_text(encoding="utf-8"))
        source.write_text(text, encoding="utf-8")
    used = called("python", "-c", KERNEL_CALL.replace("NearestIndex", "OlderIndex"))
    assert (used.returncode, used.stdout.split()[0]) == (0, "1.0"), used.stderr
    subprocess.run(install, check=True, capture_output=True, timeout=300)
    return called


def test_the_installed_package_is_whole(call: Call):
    answer = call("python", "-c", "import verefine_viz; print(verefine_viz.__file__)")
    assert answer.returncode == 0, answer.stderr
    installed = Path(answer.stdout.strip()).parent
    package = REPOSITORY / "verefine_viz"
    assert installed != package
    files = [
        file.relative_to(package) for file in package.rglob("*") if file.is_file() and "__pycache__" not in str(file)
    ]
    assert len(files) > 400
    assert [file for file in files if not (installed / file).is_file()] == []
    assert {file.name for file in (installed / "sessions").iterdir()} == {
        file.name for file in (REPOSITORY / "sessions").glob("*.toml")
    }


def test_kernels_of_an_older_version_are_neither_read_nor_kept(call: Call, kernels: Path):
    (older,) = kernels.iterdir()
    answer = call("python", "-c", KERNEL_CALL)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.split() == ["1.0", str(next(kernels.iterdir()))]
    assert list(kernels.iterdir()) != [older]


def test_a_batch_of_a_built_in_session_runs_and_verifies(call: Call, empty: Path):
    answer = call("verefine-viz", "batch", "mug", "--out", "runs")
    assert answer.returncode == 0, answer.stderr
    with (empty / "runs" / "frames.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["status"] == "ok"
    (run,) = (empty / "runs").rglob("*.vfrun")
    again = call("python", "-m", "verefine_viz", "replay", str(run), "--verify")
    assert again.returncode == 0, again.stderr


def test_a_wrong_name_lists_the_built_in_sessions(call: Call):
    answer = call("verefine-viz", "view", "mugg")
    assert answer.returncode != 0
    assert "mug" in answer.stderr
    assert "clutter" in answer.stderr
