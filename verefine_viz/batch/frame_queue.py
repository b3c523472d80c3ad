"""Which frame a batch gives out next."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterable, Iterator

from verefine_viz.scenes.frames import parse_frame


class FrameQueue:
    """The frames of a batch, each given out once, or again where its worker died.

    Args:
        frames: taken one by one, when a worker is free.
        in_order: those of a scene one after the other, as each begins with the answers of those before.
    """

    def __init__(self, frames: Iterable[str], in_order: bool) -> None:
        self._waiting: Iterator[str] = iter(frames)
        self._in_order = in_order
        self._held: deque[str] = deque()
        """Frames that wait for another of their scene."""
        self._again: deque[str] = deque()

    def again(self, frame: str) -> None:
        """Gives a frame out another time: last, so that the others are done whatever happens, or in order the next."""
        if self._in_order:
            self._held.appendleft(frame)
        else:
            self._again.append(frame)

    def take(self, busy: Collection[str]) -> str | None:
        """The next frame while ``busy`` are being solved; None where none can be given out now."""
        if not self._in_order:
            return next(self._waiting, None) or (self._again.popleft() if self._again else None)
        taken = {parse_frame(frame)[0] for frame in busy}
        for frame in self._held:
            if parse_frame(frame)[0] not in taken:
                self._held.remove(frame)
                return frame
        taken |= {parse_frame(frame)[0] for frame in self._held}
        for frame in self._waiting:
            if parse_frame(frame)[0] not in taken:
                return frame
            self._held.append(frame)
        return None
