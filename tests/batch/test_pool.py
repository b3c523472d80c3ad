"""Workers that die, end, and are ended; which frame is given out next; what is told while models are prepared."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Iterator
from pathlib import Path

import psutil
import pytest

from tests.batch import fragile
from verefine_viz.batch import worker_pool as pool_module
from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.work_queue import WorkQueue
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.core.settings import Session
from verefine_viz.run.kernel_compilation import COMPILING
from verefine_viz.run.record import RunEnd, RunRecord
from verefine_viz.run.session_file import resolve


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, processes: None) -> FrameWork:
    """Done by fragile workers."""
    monkeypatch.setattr(pool_module, "work", fragile.work)
    return FrameWork(Session(), tmp_path)


def ends(results: Iterable[RunRecord | str | None]) -> dict[str, RunEnd]:
    """How each frame ended; each is answered once."""
    records = [result for result in results if isinstance(result, RunRecord)]
    ends = {record.header.frame: record.end for record in records if record.end is not None}
    assert len(ends) == len(records)
    return ends


@pytest.mark.parametrize("n_workers", [1, 2])
def test_a_worker_that_dies_takes_only_its_frame_with_it_and_why_it_takes_long_is_said_once(
    n_workers: int, work: FrameWork
) -> None:
    frames = [*fragile.TAKES_LONG, "0/1", fragile.DIES_ONCE, fragile.EXITS, "0/2", fragile.DIES]
    pool = Pool(work, n_workers)
    results = list(pool.solve(frames))
    pool.close()
    found = ends(results)
    assert sorted(found) == sorted(frames)
    messages = {frame: end.answers[0].message for frame, end in found.items() if end.failed}
    assert messages.keys() == {fragile.DIES, fragile.EXITS}
    assert "killed by SIGKILL" in messages[fragile.DIES]
    assert "exit code 3" in messages[fragile.EXITS]
    assert [result for result in results if isinstance(result, str)] == [fragile.WHY]


def test_frames_are_asked_for_only_when_a_worker_is_free(work: FrameWork) -> None:
    asked: list[str] = []

    def frames() -> Iterator[str]:
        for i in range(100_000):
            asked.append(f"0/{100 + i}")
            yield asked[-1]

    pool = Pool(work, 2)
    results = pool.solve(frames())
    for n_done in range(1, 6):
        next(results)
        assert len(asked) <= n_done + 2
    pool.close()


def test_a_worker_that_holds_too_much_is_replaced(work: FrameWork) -> None:
    pool = Pool(work, 1, limit_bytes=1)
    assert pool.warning == ""
    pids = [end.seconds for end in ends(pool.solve(["0/1", "0/2"])).values()]
    pool.close()
    assert len(set(pids)) == 2
    assert "2 were restarted" in pool.warning
    assert pool.needs.startswith("1 × ")


def test_there_are_as_many_workers_as_frames_need_they_share_the_memory_and_none_is_left(work: FrameWork) -> None:
    me, on_ctrl_c = psutil.Process(), signal.getsignal(signal.SIGINT)
    before = {p.pid for p in me.children() if "spawn_main" in " ".join(p.cmdline())}
    pool = Pool(work, 100_000)
    pids = [end.seconds for k in (1, 2) for end in ends(pool.solve([f"0/{k}"])).values()]
    assert len(set(pids)) == 1
    next(pool.solve(["0/3", "0/4"]))
    workers = [p for p in me.children() if "spawn_main" in " ".join(p.cmdline()) and p.pid not in before]
    assert len(workers) == 2
    pool.close()
    assert pool.warning == ""
    assert not any(p.is_running() for p in workers)
    assert signal.getsignal(signal.SIGINT) is on_ctrl_c


@pytest.mark.usefixtures("processes")
def test_convex_parts_are_named_by_name_when_they_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    scene, method = {"demo": "bowl", "model_points": 300}, {"name": "refine", "iterations": 1}
    session = resolve({"scene": scene, "method": method, "recording": {"keep": "none"}})
    told: list[list[str]] = []
    for start in "ab":
        pool = Pool(FrameWork(session, tmp_path / start), 1)
        heard = list(pool.solve(["0/0"]))
        pool.close()
        assert [result.is_complete for result in heard if isinstance(result, RunRecord)] == [True]
        told.append([words for words in heard if isinstance(words, str) and words != COMPILING])
    assert any("(bowl)" in words for words in told[0])
    assert told[1] == []


# Which frame is given out next

FRAMES = ["1/1", "1/2", "2/1", "1/3", "2/2"]


def scene_of(frame: str) -> str:
    return frame.partition("/")[0]


def test_in_any_order_the_next_is_given_and_one_that_cost_a_worker_last() -> None:
    queue = WorkQueue(FRAMES, lambda frame: None)
    assert [queue.take(["1/1"]) for _ in range(2)] == ["1/1", "1/2"]
    queue.again("1/1")
    assert [queue.take([]) for _ in range(5)] == ["2/1", "1/3", "2/2", "1/1", None]


def test_in_order_a_scene_is_with_one_worker_at_a_time() -> None:
    queue = WorkQueue(FRAMES, scene_of)
    assert queue.take([]) == "1/1"
    assert queue.take(["1/1"]) == "2/1"
    assert queue.take(["1/1", "2/1"]) is None
    assert queue.take(["2/1"]) == "1/2"
    queue.again("1/2")  # Its worker died: what comes after it waits.
    assert queue.take(["2/1"]) == "1/2"
    assert queue.take(["2/1", "1/2"]) is None
    assert queue.take(["1/2"]) == "2/2"
    assert queue.take([]) == "1/3"
    assert queue.take([]) is None
    arriving = WorkQueue(iter(["1/1", "1/2"]), scene_of)
    assert [arriving.take([]), arriving.take(["1/1"]), arriving.take([])] == ["1/1", None, "1/2"]
