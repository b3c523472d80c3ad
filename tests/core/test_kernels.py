"""Compiled functions: each version has a folder of its own, and the clock of a run leaves their compilation out."""

from __future__ import annotations

import importlib.util
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from numba import config, njit

from verefine_viz.core import kernels
from verefine_viz.core.clock import Clock, clock
from verefine_viz.core.kernels import OWNER, kernel, made_folder
from verefine_viz.run.kernel_compilation import compiling_reported

KERNEL = """
from typing import NamedTuple
from verefine_viz.core.kernels import kernel

class Older(NamedTuple):
    x: float

@kernel()
def twice(pair):
    return 2 * pair.x
"""


def increased(x: Any) -> Any:
    return x + 1


def started_with(path: Path) -> Any:
    """A module as a new start of the program reads it: with nothing in memory."""
    spec = importlib.util.spec_from_file_location(f"{path.parent.name}.{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_type_that_was_renamed_leaves_nothing_of_the_older_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package, root = tmp_path / "package", tmp_path / "cache"
    package.mkdir()
    file = package / "kernel_of_test.py"
    monkeypatch.setattr(kernels, "cache_folder", lambda: made_folder(root, package, "0.1"))
    before = config.CACHE_DIR
    for name in ("Older", "Newer"):
        file.write_text(KERNEL.replace("Older", name))
        module = started_with(file)
        assert module.twice(getattr(module, name)(2.0)) == 4.0, name
        assert list(made_folder(root, package, "0.1").rglob("*.nbi")), name
        assert len(list(root.iterdir())) == 1, f"{name}: older ones are removed"
    assert before == config.CACHE_DIR, "a user's kernels stay where they are"


def test_folders_of_other_packages_stay_while_those_are_there(tmp_path: Path) -> None:
    root, packages = tmp_path / "cache", [tmp_path / name for name in ("a", "b", "gone")]
    for package in packages:
        package.mkdir()
        (package / "k.py").write_text("@kernel()")
    foreign = root / "somebody"
    foreign.mkdir(parents=True)
    a, b, gone = (made_folder(root, package, "0.1") for package in packages)
    assert len({a, b, gone}) == 3
    (packages[2] / "k.py").unlink()
    packages[2].rmdir()
    (packages[0] / "other.py").write_text("no kernel")
    assert made_folder(root, packages[0], "0.1") == a, "other sources do not count"
    assert made_folder(root, packages[0], "0.2") != a
    assert {path.name for path in root.iterdir()} == {b.name, made_folder(root, packages[0], "0.2").name, foreign.name}
    assert (b / OWNER).read_text() == str(packages[1])


def test_a_folder_that_cannot_be_made_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert made_folder(tmp_path / "file" / "cache", tmp_path, "0.1").name.startswith("verefine-viz-0.1-")


def test_a_clock_leaves_out_what_it_was_stopped_for(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [10.0]
    monkeypatch.setattr("verefine_viz.core.clock.perf_counter", lambda: now[0])
    watch, shown = Clock(), []
    for seconds, act in (
        (1, None),
        (2, watch.stop),
        (4, watch.stop),
        (8, watch.resume),
        (16, watch.resume),
        (32, None),
    ):
        if act:
            act()
        now[0] += seconds
        shown.append(watch() - 10)
    assert shown == [1, 1, 1, 1, 17, 49]


def test_the_clock_of_runs_stands_still_while_a_kernel_is_compiled() -> None:
    part = njit(lambda: 1)
    whole = njit(lambda: part() + 1)
    seen: list[float] = []

    def report() -> None:
        seen.append(clock())
        time.sleep(0.01)
        seen.append(clock())

    with compiling_reported(report):
        whole()
    assert len(seen) == 4
    assert len(set(seen)) == 1
    assert clock() > seen[0]


def test_two_types_that_are_saved_at_once_keep_a_code_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As two processes do that start after an installation and call a kernel with other types."""
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path)
    # Numba has no public way to its files.
    dispatchers: list[Any] = [kernel()(increased) for _ in range(2)]
    first, second = (dispatcher._cache._cache_file for dispatcher in dispatchers)
    Path(first._cache_path).mkdir(parents=True, exist_ok=True)
    has_read, load = threading.Event(), first._load_index

    def slowly() -> object:
        listed = load()
        has_read.set()
        time.sleep(0.3)  # Long enough for the other one to come between, where it does not wait.
        return listed

    monkeypatch.setattr(first, "_load_index", slowly)
    saving = threading.Thread(target=first.save, args=("for floats", "code for floats"))
    saving.start()
    assert has_read.wait(60)
    second.save("for integers", "code for integers")
    saving.join()
    assert [second.load(key) for key in ("for floats", "for integers")] == ["code for floats", "code for integers"]
