"""Whoever waits for kernels to be compiled is told, and nobody else."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from numba import config, njit

from tests.core.test_kernels import started_with
from verefine_viz.run.kernel_compilation import CompilingTurn, compiling_reported

KERNEL = """
from numba import njit

@njit(cache=True)
def twice(x):
    return 2 * x
"""


class Told:
    """How often it was told."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> None:
        self.times += 1


def test_told_once_after_installing_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "kernel.py"
    path.write_text(KERNEL)
    starts = []
    for _ in range(2):
        told = Told()
        with compiling_reported(told):
            kernel = started_with(path)
            assert told.times == 0, "nothing was called yet"
            assert kernel.twice(2) == kernel.twice(2) == 4
        starts.append(told.times)
    assert starts == [1, 0]


def test_each_hears_of_its_own_thread_and_only_inside() -> None:
    inner, outer, after = njit(lambda: 1), njit(lambda: 2), njit(lambda: 3)
    here, there = Told(), Told()

    def elsewhere() -> None:
        with compiling_reported(there):
            inner()

    with compiling_reported(here):
        thread = threading.Thread(target=elsewhere)
        thread.start()
        thread.join()
        assert (here.times, there.times) == (0, 1)
        outer()
    after()
    assert (here.times, there.times) == (1, 1)


def test_the_time_is_that_of_a_kernel_with_its_parts_and_of_the_report() -> None:
    part = njit(lambda: 1)
    kernel, events = njit(lambda: part() + 1), []

    @contextmanager
    def timed() -> Iterator[None]:
        events.append("begin")
        yield
        events.append("end")

    with compiling_reported(lambda: events.append("report"), timed):
        kernel()
        events.append("called")
        kernel()
    assert events == ["begin", "report", "report", "end", "called"]


def test_one_compiles_and_the_others_wait_until_it_is_done(tmp_path: Path) -> None:
    file = tmp_path / "cache" / "compiling.lock"
    first, events = CompilingTurn(file), []

    def later() -> None:
        other = CompilingTurn(file)
        other.take()
        events.append("other")
        other.end()

    first.take()
    first.take()
    threads = [threading.Thread(target=later) for _ in range(2)]
    for thread in threads:
        thread.start()
    time.sleep(0.3)
    events.append("first")
    first.end()
    for thread in threads:
        thread.join()
    assert events == ["first", "other", "other"]
    assert list(file.parent.iterdir()) == []
