"""Small pictures, made on a thread of their own when a browser asks for them."""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from msgspec import structs

from verefine_viz.core.errors import VerefineError
from verefine_viz.core.problem import Problem
from verefine_viz.core.protocols import Verifier
from verefine_viz.core.settings import SceneSettings, ScoreSettings, Session
from verefine_viz.diagnosis.films import films_of
from verefine_viz.page.gallery import Gallery, GalleryEntry
from verefine_viz.page.live_gallery import LiveGallery
from verefine_viz.pictures.answer_pictures import picture_source, thumbnail, webp
from verefine_viz.rendering.registry import make_verifier
from verefine_viz.run.run_file import read_run_file
from verefine_viz.scenes.source import SceneSource

_LOG = logging.getLogger(__name__)
WIDTH_PX = 320
"""Width of a picture; 5 to 12 kB each."""
_MOST_PICTURES = 4000
_MOST_FRAMES = 6
K = TypeVar("K")
"""What a picture is of."""


class Thumbnails(Generic[K]):
    """Pictures by answer, or by whatever else is drawn.

    Args:
        draw: makes one, as WebP; empty where it cannot.
    """

    def __init__(self, draw: Callable[[K], bytes]) -> None:
        self._draw = draw
        self._pictures: OrderedDict[K, Future[bytes]] = OrderedDict()
        self._wanted: list[K] = []
        self._wake = threading.Condition()
        self._stopping = False
        self._thread: threading.Thread | None = None

    def ask(self, entry: K) -> Future[bytes]:
        """Return the picture, once it is made; what was asked for last is made first. Empty = there is none."""
        with self._wake:
            if entry not in self._pictures:
                self._pictures[entry] = Future()
                self._wanted.append(entry)
                while len(self._pictures) > _MOST_PICTURES:
                    self._pictures.popitem(last=False)
                if self._thread is None:
                    self._thread = threading.Thread(target=self._work, name="verefine-thumbnails", daemon=True)
                    self._thread.start()
                self._wake.notify_all()
            return self._pictures[entry]

    def stop(self) -> None:
        """End after the current picture."""
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
                entry = self._wanted.pop()
                picture = self._pictures.get(entry)
            if picture is not None:
                picture.set_result(self._drawn(entry))

    def _drawn(self, entry: K) -> bytes:
        try:
            return self._draw(entry)
        except VerefineError as error:  # Its images may be gone: the words remain.
            _LOG.info("no picture of %s: %s", entry, error)
        except Exception:
            _LOG.exception("no picture of %s", entry)
        return b""


@dataclass(frozen=True)
class AnswerPicture:
    """What is drawn of an answer: its small picture, or its film."""

    entry: GalleryEntry
    is_film: bool = False


class Painter:
    """Draws answers of a gallery. Belongs to one thread.

    Args:
        gallery: returns the gallery as it is now.
    """

    def __init__(self, gallery: Callable[[], Gallery]) -> None:
        self._gallery = gallery
        self._sources: dict[SceneSettings, SceneSource] = {}
        self._problems: OrderedDict[tuple[SceneSettings, str], Problem] = OrderedDict()
        self._verifiers: dict[ScoreSettings, Verifier] = {}

    def draw(self, of: AnswerPicture) -> bytes:
        """Draw what is asked for, as WebP.

        Raises:
            VerefineError: what it takes cannot be read.
        """
        return self.film(of.entry) if of.is_film else self(of.entry)

    def __call__(self, entry: GalleryEntry) -> bytes:
        """Draw an answer, as WebP.

        Raises:
            VerefineError: its frame cannot be read, or does not hold the object.
        """
        row = entry.row
        if entry.is_waiting:
            return thumbnail(self._problem(entry).targets[0], None, WIDTH_PX)
        if row.instance_id is None:
            return b""
        answer = self._gallery().runs[entry.run].answers(row.frame).get(row.instance_id)
        target = self._problem(entry).target(row.instance_id)
        return thumbnail(target, answer, WIDTH_PX)

    def film(self, entry: GalleryEntry) -> bytes:
        """Draw the key moments of an answer as a strip, from its run file, as WebP; empty where it has none.

        Raises:
            VerefineError: its frame, or the file of its run, cannot be read.
        """
        gallery, row = self._gallery(), entry.row
        path = gallery.loose_record(entry) or gallery.records(entry.run)(row.frame)
        if path is None or row.instance_id is None:
            return b""
        verifier = self._verifier(gallery.runs[entry.run].session)
        film = films_of(read_run_file(path), self._problem(entry), lambda k: verifier).get(row.instance_id)
        return b"" if film is None else webp(np.asarray(film.strip(f"{row.name}   frame {row.frame}")))

    def _verifier(self, session: Session) -> Verifier:
        if self._verifiers.get(session.score) is None:
            self._verifiers[session.score] = make_verifier(session.score)
        return self._verifiers[session.score]

    def _problem(self, entry: GalleryEntry) -> Problem:
        index = self._gallery().runs[entry.run]
        # Runs on the same data share it.
        data = structs.replace(index.session.scene, frames=())
        if data not in self._sources:
            is_fixed = index.session.scene.source != "demo" and not isinstance(self._gallery(), LiveGallery)
            frames = index.frames if is_fixed else ()
            self._sources[data] = picture_source(index.session, frames)
        if (data, entry.row.frame) not in self._problems:
            self._problems[(data, entry.row.frame)] = self._sources[data].problem(entry.row.frame)
            while len(self._problems) > _MOST_FRAMES:
                self._problems.popitem(last=False)
        return self._problems[(data, entry.row.frame)]
