"""How fast frames are solved, and how long the rest of them takes, from when each began and ended."""

from __future__ import annotations

import heapq
import math
from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from verefine_viz.run.answers import once_s
from verefine_viz.run.record import RunEnd


@dataclass
class _Durations:
    """What objects take [s]. The k-th frame counts k times: what came last says most about what comes next."""

    n: int = 0
    mean: float = 0.0
    mean_square: float = 0.0

    def add(self, seconds: float) -> None:
        self.n += 1
        share = 2 / (self.n + 1)
        self.mean += share * (seconds - self.mean)
        self.mean_square += share * (seconds**2 - self.mean_square)

    @property
    def spread(self) -> float:
        return math.sqrt(max(self.mean_square - self.mean**2, 0.0))

    def with_late(self, taken: list[float]) -> float:
        """The mean, with frames that are late counted by what they have taken so far [s per object]."""
        longest = [max(self.mean, seconds + self.spread) for seconds in taken]
        return (self.mean * self.n + sum(longest)) / (self.n + len(longest))


class Pace:
    """Frames of a batch, several at a time, each by a worker that takes the next one when it is done.

    A frame's time grows with the number of its objects. What is compiled and prepared once is left out. So are the
    frames that are not like the others, as soon as there are others: the first of each worker, which loads libraries
    meanwhile. Times are those of any clock [s]; one thread reports the frames, any thread may ask.
    """

    def __init__(self) -> None:
        self._waiting: dict[Hashable, int] = {}
        """Objects of frames that are still to begin, where they are known."""
        self._n_counted = self._n_objects = 0
        """Frames whose objects are known, and these together."""
        self._begun: dict[Hashable, tuple[float, float]] = {}
        """When each began, and its objects."""
        self._unusual: set[Hashable] = set()
        self._once: dict[Hashable, str] = {}
        self._durations = _Durations()
        self._only_unusual = True
        self._n_workers = 0
        self._first_done: float | None = None
        self._changed = self._worked_s = 0.0

    def expect(self, n_objects: Mapping[str, int]) -> None:
        """Frames that are to come, as far as it is known how many objects they have."""
        self._waiting = dict[Hashable, int](n_objects.items())
        self._n_counted += len(n_objects)
        self._n_objects += sum(n_objects.values())

    def begin(self, frame: Hashable, now: float) -> None:
        """A worker begins with a frame."""
        self._count_work(now)
        self._begun[frame] = now, self._waiting.pop(frame, self._mean_objects)
        self._n_workers = max(self._n_workers, len(self._begun))
        if self._first_done is None:
            self._unusual.add(frame)

    def slow_down(self, frame: Hashable, why: str) -> None:
        """A frame in work has something compiled or prepared, which later ones need not repeat."""
        self._unusual.add(frame)
        self._once[frame] = why

    def end(self, frame: Hashable, now: float, end: RunEnd | None = None) -> None:
        """A frame is done; ``end`` has what its worker needed for it alone, None = unknown."""
        self._count_work(now)
        began, n_objects = self._begun.pop(frame)
        self._once.pop(frame, None)
        if self._first_done is None:
            self._first_done = now
        took_s = now - began
        if frame in self._unusual:
            self._unusual.remove(frame)
            if not self._only_unusual:
                return
            took_s = end.seconds if end is not None and end.seconds else took_s
        elif self._only_unusual:
            self._only_unusual, self._durations = False, _Durations()
        self._durations.add(max(took_s - (0.0 if end is None else once_s(end)), 0.0) / n_objects)

    @property
    def once(self) -> tuple[str, ...]:
        """What is compiled or prepared in the frames in work; the time left is without it."""
        return tuple(self._once.copy().values())

    @property
    def frame_s(self) -> float | None:
        """Mean time between two results; None while there is none."""
        return self._durations.mean * self._mean_objects / self._frames_in_work if self._durations.n else None

    def left_s(self, n_left: int, now: float) -> float | None:
        """Time until ``n_left`` frames are done, with those in work; None while none is done."""
        if not self._durations.n:
            return None
        begun, waiting = self._begun.copy(), self._waiting.copy()
        unusual, once = self._unusual.copy(), self._once.copy()
        taken = {frame: (now - began, n_objects) for frame, (began, n_objects) in begun.items()}
        object_s = self._durations.with_late([s / n for frame, (s, n) in taken.items() if frame not in unusual])
        # When each worker is free: one that is late, as late again.
        free = []
        for frame, (taken_s, n_objects) in taken.items():
            early_s = object_s * n_objects - taken_s
            late_s = 0.0 if frame in once else -early_s
            free.append(max(early_s, late_s, self._durations.spread * n_objects))
        n_waiting = max(n_left - len(free), 0)
        free += [0.0] * min(self._n_workers - len(free), n_waiting)
        # The next frame goes to the worker that is free first; frames that wait count as equal.
        n_objects = sum(waiting.values()) + (n_waiting - len(waiting)) * self._mean_objects
        frame_s = object_s * n_objects / max(n_waiting, 1)
        n_far = max(n_waiting - 2 * self._n_workers, 0)
        heapq.heapify(free)
        for _ in range(n_waiting - n_far):
            heapq.heapreplace(free, free[0] + frame_s)
        at_once_s = max(free, default=0.0) + n_far * frame_s / self._n_workers
        return at_once_s * self._n_workers / self._frames_in_work

    @property
    def _mean_objects(self) -> float:
        return self._n_objects / self._n_counted if self._n_counted else 1.0

    @property
    def _frames_in_work(self) -> float:
        """Frames in work on average, which is less than there are workers where these wait, as between two runs."""
        passed_s = self._changed - (self._changed if self._first_done is None else self._first_done)
        return self._worked_s / passed_s if passed_s and self._worked_s else self._n_workers

    def _count_work(self, now: float) -> None:
        if self._first_done is not None:
            self._worked_s += (now - self._changed) * len(self._begun)
        self._changed = now
