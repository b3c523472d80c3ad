"""Workers that die, end, and are ended."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from pathlib import Path

import psutil
import pytest

from tests.batch import fragile
from verefine_viz.batch import worker_pool as pool_module
from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunEnd, RunRecord

pytestmark = pytest.mark.usefixtures("processes")


@pytest.fixture(autouse=True)
def _fragile_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pool_module, "work", fragile.work)


def solved(frames: list[str], n_workers: int, out: Path) -> dict[str, str]:
    """Each frame's message; empty where it was solved."""
    pool = Pool(FrameWork(Session(), out), n_workers)
    try:
        results = list(pool.solve(frames))
    finally:
        pool.close()
    assert sorted(ends(results)) == sorted(frames)
    return {frame: end.answers[0].message if end.failed else "" for frame, end in ends(results).items()}


def ends(results: Iterable[RunRecord | str | None]) -> dict[str, RunEnd]:
    """How each frame ended; each is answered once."""
    records = [result for result in results if isinstance(result, RunRecord)]
    ends = {record.header.frame: record.end for record in records if record.end is not None}
    assert len(ends) == len(records)
    return ends


@pytest.mark.parametrize("n_workers", [1, 2])
def test_a_worker_that_dies_takes_only_its_frame_with_it(n_workers: int, tmp_path: Path) -> None:
    frames = ["0/1", fragile.DIES_ONCE, fragile.EXITS, "0/2", fragile.DIES]
    messages = solved(frames, n_workers, tmp_path)
    assert "killed by SIGKILL" in messages.pop(fragile.DIES)
    assert "exit code 3" in messages.pop(fragile.EXITS)
    assert set(messages.values()) == {""}


def test_frames_are_asked_for_only_when_a_worker_is_free(tmp_path: Path) -> None:
    asked: list[str] = []

    def frames() -> Iterator[str]:
        for i in range(100_000):
            asked.append(f"0/{100 + i}")
            yield asked[-1]

    pool = Pool(FrameWork(Session(), tmp_path), 2)
    results = pool.solve(frames())
    for n_done in range(1, 6):
        next(results)
        assert len(asked) <= n_done + 2
    pool.close()


def test_a_worker_that_holds_too_much_is_replaced(tmp_path: Path) -> None:
    pool = Pool(FrameWork(Session(), tmp_path), 1, limit_bytes=1)
    assert pool.warning == ""
    pids = [end.seconds for end in ends(pool.solve(["0/1", "0/2"])).values()]
    pool.close()
    assert len(set(pids)) == 2
    assert "2 were restarted" in pool.warning
    assert pool.needs.startswith("1 × ")


def test_memory_is_shared_by_the_workers_that_frames_need(tmp_path: Path) -> None:
    pool = Pool(FrameWork(Session(), tmp_path), 100_000)
    pids = [end.seconds for k in (1, 2) for end in ends(pool.solve([f"0/{k}"])).values()]
    pool.close()
    assert len(set(pids)) == 1
    assert pool.warning == ""


def test_why_it_takes_long_is_said_once_and_every_frame_is_answered(tmp_path: Path) -> None:
    frames = [*fragile.TAKES_LONG, "0/1", "0/2"]
    pool = Pool(FrameWork(Session(), tmp_path), 2)
    results = list(pool.solve(frames))
    pool.close()
    assert [r for r in results if isinstance(r, str)] == [fragile.WHY]
    assert sorted(ends(results)) == sorted(frames)


def test_no_more_workers_than_frames_and_none_left_behind(tmp_path: Path) -> None:
    me, on_ctrl_c = psutil.Process(), signal.getsignal(signal.SIGINT)
    before = {p.pid for p in me.children() if "spawn_main" in " ".join(p.cmdline())}
    pool = Pool(FrameWork(Session(), tmp_path), 8)
    results = pool.solve(["0/1", "0/2"])
    next(results)
    workers = [p for p in me.children() if "spawn_main" in " ".join(p.cmdline()) and p.pid not in before]
    assert len(workers) == 2
    pool.close()
    assert not any(p.is_running() for p in workers)
    assert signal.getsignal(signal.SIGINT) is on_ctrl_c
