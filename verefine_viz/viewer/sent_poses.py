"""Poses that a handle on the page sent itself: it shows them already, or a later one that is still on its way."""

from __future__ import annotations

from collections import deque

from verefine_viz.viewer.commands import Pose


class SentPoses:
    """Keeps what a handle shows from being overwritten by its own echo, and lets all other poses through."""

    def __init__(self) -> None:
        self._sent: deque[Pose] = deque(maxlen=200)
        self._shown: Pose | None = None

    def add(self, pose: Pose) -> None:
        """The handle sends a pose."""
        self._sent.append(pose)

    def is_news(self, pose: Pose) -> bool:
        """Whether the handle has to be moved to ``pose``; it counts as moved then."""
        if pose == self._shown:
            return False
        self._shown = pose
        if pose in self._sent:
            return False
        self._sent.clear()
        return True

    def clear(self) -> None:
        """Nothing is edited any more."""
        self._sent.clear()
        self._shown = None
