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
    """The gallery of a watch as it is at the moment; :meth:`refreshed` makes the current one later."""

    def __init__(self, watch: Watch) -> None:
        indices, self.fault = watch.latest
        super().__init__(indices)
        self._watch = watch

    def refreshed(self) -> LiveGallery:
        """Return the gallery as it is now."""
        return LiveGallery(self._watch)

    def session(self, run: str) -> Session:
        """Return the session that opens a run: all its frames, also those to come."""
        return self.runs[run].session

    def frames(self, run: str) -> tuple[str, ...]:
        """Return the frames of a run, by number."""
        frames = {entry.row.frame for entry in self.entries if entry.run == run}
        return tuple(sorted(frames, key=parse_frame))

    @cached_property
    def folder(self) -> None:
        """None: a watch has no finished folder."""
        return None

    @cached_property
    def first_filter(self) -> dict[str, str]:
        """No filter: all answers are shown until the user chooses one."""
        return {}

    @cached_property
    def outcome(self) -> str:
        """How many objects are right, and what keeps frames from being solved, in words."""
        words = super().outcome
        return f"{words}; {self.fault.rstrip('.')}" if self.fault else words
