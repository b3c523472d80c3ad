"""The clock by which the times of a run are taken: it stands still while a kernel is compiled.

Kernels are compiled once after installing, for a minute or two in all, which says nothing about a method or a refiner.
"""

from __future__ import annotations

from threading import Lock
from time import perf_counter


class Clock:
    """Seconds since an arbitrary moment, less those in which it was stopped; for all threads of a process."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._n_stops = 0
        self._stopped_at = 0.0
        self._left_out_s = 0.0

    def __call__(self) -> float:
        """Return the time [s]."""
        with self._lock:
            return (self._stopped_at if self._n_stops else perf_counter()) - self._left_out_s

    def stop(self) -> None:
        """Stop it, until it is resumed as often as it was stopped."""
        with self._lock:
            if self._n_stops == 0:
                self._stopped_at = perf_counter()
            self._n_stops += 1

    def resume(self) -> None:
        """Let it go on."""
        with self._lock:
            self._n_stops -= 1
            if self._n_stops == 0:
                self._left_out_s += perf_counter() - self._stopped_at


clock = Clock()
"""That of this process."""
