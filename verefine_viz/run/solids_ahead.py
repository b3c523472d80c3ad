"""Makes the convex parts of a frame's models on threads of their own, while the frame is looked at and scored.

A step that needs parts which are not made yet waits only for these: the thread that makes them holds their lock file
(``core.array_cache``).
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

from verefine_viz.core.errors import Cancelled, ShapeError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.physics.colliders import Collider, collider, known_collider


class SolidsAhead:
    """Makes convex parts of models, on as many threads as there are cores but one.

    Args:
        on_other: called on such a thread with a model whose parts could not be made as asked for, because CoACD failed
            or took too long. A frame that shows the model has to be read again.
    """

    def __init__(self, on_other: Callable[[ObjectModel], None]) -> None:
        self._on_other = on_other
        self._ended = threading.Event()
        self._token = ProgressToken(is_wanted=lambda: not self._ended.is_set())
        self._threads = ThreadPoolExecutor(max(1, len(os.sched_getaffinity(0)) - 1), "verefine-solids")
        self._asked: dict[str, ObjectModel] = {}
        self._begun: set[str] = set()
        self._faults: dict[str, ShapeError] = {}

    @staticmethod
    def makes(settings: PhysicsSettings) -> bool:
        """Whether settings ask for such parts; hulls and parts from files are there at once."""
        return settings.collider == "decomposition" and not settings.collider_folder

    def solid_of(self, model: ObjectModel, progress: ProgressToken) -> Collider | None:
        """The parts of a model; None = they will be made after :meth:`begin`.

        Raises:
            ShapeError: it has no volume, or CoACD failed on it before.
            Cancelled: through ``progress``.
        """
        known = known_collider(model, "decomposition")
        if known is not None:
            return known
        if model.mesh_hash in self._faults:
            raise self._faults[model.mesh_hash]
        collider(model, "hull", progress=progress)  # A model without volume is recognized at once.
        self._asked[model.mesh_hash] = model
        return None

    def begin(self) -> None:
        """Begin to make the missing parts that were asked for, once the frame can be drawn and scored."""
        for mesh_hash in self._asked.keys() - self._begun:
            self._begun.add(mesh_hash)
            self._threads.submit(self._make, self._asked[mesh_hash])

    def stop(self) -> None:
        """Stop making parts; nothing unfinished is left behind."""
        self._ended.set()
        self._threads.shutdown(cancel_futures=True)

    def _make(self, model: ObjectModel) -> None:
        with suppress(Cancelled):
            try:
                is_other = bool(collider(model, "decomposition", progress=self._token).note)
            except ShapeError as error:
                self._faults[model.mesh_hash], is_other = error, True
            if is_other:
                self._on_other(model)
