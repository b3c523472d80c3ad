"""The time that is left, against the time that it takes, in made-up runs on a made-up clock."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.batch.at_once import AtOnceBackend
from tests.batch.conftest import N_FRAMES
from verefine_viz.batch import run_batch as run_batch_module
from verefine_viz.batch.pace import Pace
from verefine_viz.batch.run_batch import run_batch
from verefine_viz.run.record import RunEnd
from verefine_viz.run.session_file import load_session

FACTOR = 1.5
EVERY_S = 0.3
"""Time between two readings."""
N_WORKERS = (1, 2, 8)


@dataclass(frozen=True)
class Reading:
    """What is shown at one moment."""

    share_done: float
    left_s: float | None
    true_s: float
    frame_s: float | None

    def is_right(self, slack_s: float) -> bool:
        return (
            self.left_s is not None and self.true_s / FACTOR - slack_s <= self.left_s <= self.true_s * FACTOR + slack_s
        )


def readings(
    durations: Sequence[float],
    n_workers: int,
    start_s: float = 0.0,
    first: float = 1.0,
    once_s: Mapping[int, float] = {},
    run_of: int | None = None,
    n_objects: Mapping[str, int] = {},
) -> list[Reading]:
    """A run whose frames take these times.

    Args:
        durations: of the frames in their order [s].
        n_workers: how many of them are solved at a time.
        start_s: what each worker takes to start, in its first frame.
        first: how many times longer the first frame of each worker takes.
        once_s: what is compiled in some frames.
        run_of: frames after which workers wait for each other.
        n_objects: as :meth:`Pace.expect` gets them.
    """
    # (time, 0 = end or 1 = begin, frame, what the worker needs for it)
    events: list[tuple[float, int, int, float]] = []
    free = [0.0] * n_workers
    for k, duration in enumerate(durations):
        if run_of and k % run_of == 0:
            free = [max(free)] * n_workers
        own_s = duration * (first if k < n_workers else 1.0) + once_s.get(k, 0.0)
        began = free[0]
        ended = began + own_s + (start_s if k < n_workers else 0.0)
        heapq.heapreplace(free, ended)
        events += [(began, 1, k, 0.0), (ended, 0, k, own_s)]
    events.sort()
    pace, n_done, now, seen = Pace(), 0, 0.0, list[Reading]()
    pace.expect(n_objects)
    all_s, following = events[-1][0], iter(events)
    event = next(following)
    while now < all_s:
        while event[0] <= now:
            at, is_begin, k, own_s = event
            if is_begin:
                pace.begin(f"0/{k}", at)
                if k in once_s:
                    pace.slow_down(f"0/{k}", "Compiling.")
            else:
                n_done += 1
                compiled_ms = 1e3 * once_s.get(k, 0.0)
                pace.end(f"0/{k}", at, RunEnd(answers=(), seconds=own_s, stages_ms={"compile": compiled_ms}))
            event = next(following)
        share = n_done / len(durations)
        seen.append(Reading(share, pace.left_s(len(durations) - n_done, now), all_s - now, pace.frame_s))
        now += EVERY_S
    return seen


def share_right(seen: Sequence[Reading], frame_s: float) -> float:
    """Of the readings after the first tenth; a frame may be half as long again as the others, or a second."""
    after = [reading for reading in seen if reading.share_done >= 0.1]
    return sum(reading.is_right(max(frame_s / 2, 1.0)) for reading in after) / len(after)


Draw = Callable[[random.Random, float], float]
"""(random numbers, share of the frames before) → what a frame takes [s]."""
WELL_BEHAVED: dict[str, Draw] = {
    "all alike": lambda rng, share: 2.0,
    "a fifth more or less": lambda rng, share: max(rng.gauss(2.0, 0.4), 0.5),
    "up to a half more or less": lambda rng, share: rng.uniform(1.0, 3.0),
    "slower and slower": lambda rng, share: 1.5 + share,
    "faster and faster": lambda rng, share: 2.5 - share,
}
DIFFERENT: dict[str, Draw] = {
    "one to six objects": lambda rng, share: 0.6 * rng.randint(1, 6),
    "lognormal": lambda rng, share: rng.lognormvariate(0.3, 0.8),
    "exponential": lambda rng, share: rng.expovariate(0.5),
    "every fifth is explained": lambda rng, share: 2.0 + 10.0 * (rng.random() < 0.2),
}


def drawn(draw: Draw, n: int, seed: int) -> list[float]:
    rng = random.Random(seed)
    return [draw(rng, k / n) for k in range(n)]


@pytest.mark.parametrize("name", WELL_BEHAVED)
@pytest.mark.parametrize("n_workers", N_WORKERS)
def test_every_reading_after_the_first_tenth_is_right(name: str, n_workers: int) -> None:
    for seed in range(3):
        durations = drawn(WELL_BEHAVED[name], 50 * max(n_workers, 2), seed)
        for start_s, first, compile_s in ((0.0, 1.0, 0.0), (6.0, 3.0, 0.0), (6.0, 1.0, 40.0)):
            once_s = dict.fromkeys(range(n_workers), compile_s) if compile_s else {}
            seen = readings(durations, n_workers, start_s, first, once_s)
            assert share_right(seen, 2.0) == 1.0, (seed, start_s, first, compile_s)


@pytest.mark.parametrize("name", DIFFERENT)
@pytest.mark.parametrize("n_workers", N_WORKERS)
def test_few_readings_are_wrong_where_frames_differ_by_far(name: str, n_workers: int) -> None:
    shares = [share_right(readings(drawn(DIFFERENT[name], 800, seed), n_workers), 2.0) for seed in range(3)]
    assert sum(shares) / len(shares) > 0.95, shares


def test_frames_with_many_objects_come_last() -> None:
    n_objects = [1 + k // 10 for k in range(80)]
    durations = [0.5 * n for n in n_objects]
    names = {f"0/{k}": n for k, n in enumerate(n_objects)}
    for n_workers in (1, 2, 4):
        assert share_right(readings(durations, n_workers, n_objects=names), 4.0) == 1.0
        assert share_right(readings(durations, n_workers), 4.0) < 0.8, "it helps to know"


def test_what_is_compiled_once_is_not_in_the_rate() -> None:
    seen = readings([2.0] * 40, 2, start_s=6.0, first=3.0, once_s={0: 60.0, 1: 60.0, 20: 30.0})
    assert {round(reading.frame_s, 6) for reading in seen if reading.frame_s and reading.share_done > 0.1} == {1.0}


def test_a_frame_that_takes_longer_than_any_before_is_never_about_to_be_done() -> None:
    seen = readings([2.0] * 20 + [30.0], 1)
    late = [reading.left_s for reading in seen if reading.true_s < 26.0]
    assert all(late)
    assert late == sorted(late, key=lambda left_s: left_s or 0.0)


def test_nothing_is_known_before_the_first_result() -> None:
    pace = Pace()
    pace.begin("0/0", 0.0)
    assert (pace.left_s(3, 5.0), pace.frame_s) == (None, None)
    pace.end("0/0", 6.0)
    assert (pace.left_s(2, 6.0), pace.frame_s) == (12.0, 6.0)


def test_a_batch_counts_the_objects_of_its_frames(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected: list[Mapping[str, int]] = []
    monkeypatch.setattr(Pace, "expect", lambda self, n_objects: expected.append(n_objects))
    run_batch(load_session(session), tmp_path, AtOnceBackend())
    monkeypatch.setattr(run_batch_module, "COUNT_S", -1.0)
    run_batch(load_session(session), tmp_path / "late", AtOnceBackend())
    assert expected == [{f"7/{k}": 3 for k in range(N_FRAMES)}, {}]
