"""Small pictures of answers, made one after another on a thread of their own while they are on the page."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence

from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.pictures.answer_pictures import picture_source, thumbnail
from verefine_viz.scenes.source import SceneSource
from verefine_viz.viewer.state.batch_gallery import Entry, Gallery
from verefine_viz.viewer.state.live_gallery import LiveGallery

_LOG = logging.getLogger(__name__)
WIDTH_PX = 176
"""Twice the width on the page, for sharp screens; 2 to 4 kB each."""
_MOST_PICTURES = 2000
_MOST_FRAMES = 6


class Thumbnails:
    """Pictures by answer.

    Args:
        draw: makes one, as a data URI; empty where it cannot.
        arrived: called with the entry of each new one, on the thread of this object.
    """

    def __init__(self, draw: Callable[[Entry], str], arrived: Callable[[Entry], None]) -> None:
        self._draw, self._arrived = draw, arrived
        self._made: OrderedDict[Entry, str] = OrderedDict()
        self._wanted: list[Entry] = []
        self._current: Entry | None = None
        self._wake = threading.Condition()
        self._stopping = False
        self._thread: threading.Thread | None = None

    def of(self, entry: Entry) -> str | None:
        """The picture; None where it is not made yet."""
        with self._wake:
            return self._made.get(entry)

    def want(self, entries: Sequence[Entry]) -> None:
        """What is on the page now, in order; what was wanted before and is not made yet is dropped."""
        with self._wake:
            self._wanted = [e for e in entries if e not in self._made and e is not self._current]
            if self._wanted and self._thread is None:
                self._thread = threading.Thread(target=self._work, name="verefine-thumbnails", daemon=True)
                self._thread.start()
            self._wake.notify_all()

    def stop(self) -> None:
        """Ends after the current picture."""
        with self._wake:
            self._stopping = True
            self._wake.notify_all()
        if self._thread is not None:
            self._thread.join(timeout=20)

    def _work(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._wanted or self._stopping)
                if self._stopping:
                    return
                entry = self._current = self._wanted.pop(0)
            picture = self._picture(entry)
            with self._wake:
                self._made[entry] = picture
                while len(self._made) > _MOST_PICTURES:
                    self._made.popitem(last=False)
            self._arrived(entry)

    def _picture(self, entry: Entry) -> str:
        try:
            return self._draw(entry)
        except VerefineError as error:  # Its images may be gone: the words remain.
            _LOG.info("no picture of %s: %s", entry.row.frame, error)
        except Exception:
            _LOG.exception("no picture of %s", entry.row.frame)
        return ""


class Painter:
    """Draws answers of a gallery. Belongs to one thread."""

    def __init__(self, gallery: Gallery) -> None:
        self._gallery = gallery
        self._sources: dict[str, SceneSource] = {}
        self._problems: OrderedDict[tuple[str, str], Problem] = OrderedDict()

    def __call__(self, entry: Entry) -> str:
        """The picture of an answer as a data URI.

        Raises:
            VerefineError: its frame cannot be read, or does not hold the object.
        """
        row = entry.row
        if entry.is_waiting:
            return thumbnail(self._problem(entry).targets[0], None, WIDTH_PX)
        if row.instance_id is None:
            return ""
        answer = self._gallery.runs[entry.run].answers(row.frame).get(row.instance_id)
        target = self._problem(entry).target(row.instance_id)
        return thumbnail(target, answer, WIDTH_PX)

    def _problem(self, entry: Entry) -> Problem:
        index = self._gallery.runs[entry.run]
        # Runs on the same data share it.
        data = index.session.scene.model_copy(update={"frames": ()}).model_dump_json()
        if data not in self._sources:
            is_fixed = index.session.scene.source == "bop" and not isinstance(self._gallery, LiveGallery)
            frames = index.frames if is_fixed else ()
            self._sources[data] = picture_source(index.session, frames)
        if (data, entry.row.frame) not in self._problems:
            self._problems[(data, entry.row.frame)] = self._sources[data].problem(entry.row.frame)
            while len(self._problems) > _MOST_FRAMES:
                self._problems.popitem(last=False)
        return self._problems[(data, entry.row.frame)]
