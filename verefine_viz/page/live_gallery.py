"""The answers of a folder that is watched: frames arrive, are solved, and go."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from verefine_viz.core.frame_names import parse_frame
from verefine_viz.core.settings import Session
from verefine_viz.page.gallery import Gallery

if TYPE_CHECKING:
    from verefine_viz.batch.watch import Watch


class LiveGallery(Gallery):
    """What a watch has at the moment; :meth:`refreshed` is what it has later."""

    def __init__(self, watch: Watch) -> None:
        indices, self.fault = watch.latest
        super().__init__(indices)
        self._watch = watch

    def refreshed(self) -> LiveGallery:
        """Return what the watch has now."""
        return LiveGallery(self._watch)

    def session(self, run: str) -> Session:
        """Return what opens a run: all frames, also those to come."""
        return self.runs[run].session

    def frames(self, run: str) -> tuple[str, ...]:
        """Return those of a run, by number."""
        frames = {entry.row.frame for entry in self.entries if entry.run == run}
        return tuple(sorted(frames, key=parse_frame))

    @cached_property
    def folder(self) -> None:
        """None: its runs go on."""
        return None

    @cached_property
    def first_filter(self) -> dict[str, str]:
        """Nothing: all answers are shown until the user chooses."""
        return {}

    @cached_property
    def outcome(self) -> str:
        """How many objects are right, and what keeps frames from being solved, in words."""
        words = super().outcome
        return f"{words}; {self.fault.rstrip('.')}" if self.fault else words
