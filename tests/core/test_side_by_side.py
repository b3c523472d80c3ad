"""Jobs side by side: results in order, reports on the calling thread, and an end for all when one is enough."""

from __future__ import annotations

import threading
import time

import pytest

from tests.progress import ending_after
from verefine_viz.core.errors import Cancelled, InputError
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.side_by_side import side_by_side


def test_results_and_errors_come_in_the_order_of_the_jobs() -> None:
    def job(k: int, progress: ProgressToken) -> int:
        time.sleep(0.05 * (3 - k))
        if k == 1:
            raise InputError("no such model")
        return k

    first, second, third = side_by_side([lambda p, k=k: job(k, p) for k in range(3)], ProgressToken())
    assert (first, third) == (0, 2)
    assert isinstance(second, InputError)
    assert side_by_side([], ProgressToken()) == []


def test_reports_of_all_come_on_the_calling_thread_a_line_for_each_that_begins() -> None:
    said: list[tuple[str, float | None]] = []
    announced: list[str] = []
    threads: set[int] = set()

    def report(doing: str, share: float | None) -> None:
        threads.add(threading.get_ident())
        said.append((doing, share))

    def job(name: str, progress: ProgressToken) -> None:
        progress.announce(f"Preparing {name}.")
        progress.checkpoint(f"Preparing {name}, 1 s so far.")
        time.sleep(0.3)

    side_by_side(
        [lambda p, n=n: job(n, p) for n in ("mug", "drill")], ProgressToken(report, report_once=announced.append)
    )
    assert sorted(announced) == ["Preparing drill.", "Preparing mug."]
    assert threads == {threading.get_ident()}
    assert any("Preparing mug, 1 s so far." in doing for doing, _ in said)
    assert said[-1][1] == 1


def test_what_is_cancelled_ends_every_job() -> None:
    ended: list[bool] = []

    def job(progress: ProgressToken) -> None:
        try:
            while True:
                progress.checkpoint()
                time.sleep(0.01)
        finally:
            ended.append(True)

    with pytest.raises(Cancelled):
        side_by_side([job, job], ending_after(2))
    assert 1 <= len(ended) <= 2


def test_an_error_that_was_not_foreseen_is_not_swallowed() -> None:
    with pytest.raises(ZeroDivisionError):
        side_by_side([lambda progress: 1 // 0], ProgressToken())
