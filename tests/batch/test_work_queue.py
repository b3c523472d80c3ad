"""Which frame is given out next: any, or those of a scene one after the other."""

from __future__ import annotations

from verefine_viz.batch.work_queue import WorkQueue

FRAMES = ["1/1", "1/2", "2/1", "1/3", "2/2"]


def at_any_time(frame: str) -> None:
    """No frame waits for another."""


def scene_of(frame: str) -> str:
    return frame.partition("/")[0]


def test_in_any_order_the_next_is_given_and_one_that_cost_a_worker_last() -> None:
    queue = WorkQueue(FRAMES, at_any_time)
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


def test_in_order_frames_that_arrive_later_are_taken_too() -> None:
    arriving = iter(["1/1", "1/2"])
    queue = WorkQueue(arriving, scene_of)
    assert queue.take([]) == "1/1"
    assert queue.take(["1/1"]) is None
    assert queue.take([]) == "1/2"
