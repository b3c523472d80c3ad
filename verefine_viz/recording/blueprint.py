"""How a recording looks when it is opened, as rerun's messages: its views, and where all 3D views look from."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from verefine_viz.core.errors import InputError
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.rrd_messages import Store, messages
from verefine_viz.recording.shown import Shown, shown
from verefine_viz.recording.views import arranged, spatial_views


def blueprint_of(layout: Layout, has_maps: bool) -> rrb.Blueprint:
    """The blueprint of a recording."""
    what = shown(layout, has_maps)
    spatial = spatial_views(what)
    return _WithEye(arranged(spatial, what), spatial, layout)


def blueprint_messages(layout: Layout, has_maps: bool) -> bytes:
    """The same as messages for ``RrdFile.close``."""
    return _prepared(shown(layout, has_maps)).messages(layout)


class _WithEye(rrb.Blueprint):
    def __init__(self, views: rrb.Blueprint, spatial: Sequence[rrb.Spatial3DView], layout: Layout) -> None:
        super().__init__()
        self._views, self._spatial, self._layout = views, spatial, layout

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._views._log_to_stream(stream)
        stream.send_chunks([chunk for eye in _eyes(self._spatial, self._layout) for chunk in eye.chunks])


class _Prepared(rrb.Blueprint):
    """Views as rerun's messages, made once; only the eye differs from frame to frame."""

    def __init__(self, what: Shown) -> None:
        super().__init__()
        self._spatial = spatial_views(what)
        self._what = what
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "views.rbl"
            _make_sure_of_room(path)
            self.save(entities.APPLICATION, path)
            self._views = messages(path.read_bytes())

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        arranged(self._spatial, self._what)._log_to_stream(stream)
        self._store = Store(stream.get_recording_id() or "", is_blueprint=True)

    def messages(self, layout: Layout) -> bytes:
        # The views come first: they introduce the blueprint that the eyes belong to.
        return self._views + self._store.messages(eye.body for eye in _eyes(self._spatial, layout))


ROOM_BYTES = 1 << 20
"""More than any views take."""


def _make_sure_of_room(path: Path) -> None:
    """A disk that is full would keep rerun waiting for ever.

    Raises:
        InputError: it is.
    """
    try:
        path.write_bytes(bytes(ROOM_BYTES))
    except OSError as error:
        raise InputError(f"cannot write temporary files to {path.parents[1]}: {error.strerror}") from None
    path.unlink()


_prepared = lru_cache(maxsize=32)(_Prepared)


def _eyes(spatial: Sequence[rrb.Spatial3DView], layout: Layout) -> Iterator[Piece]:
    """All 3D views begin at the same place."""
    places = (layout.eye_world, layout.center_world, (0.0, 0.0, 1.0))
    parts = [columns.vectors(of, [place], 3) for of, place in zip(_eye_descriptors(), places, strict=True)]
    for view in spatial:
        yield chunks.rows_of(f"/{view.blueprint_path()}/EyeControls3D", [0], parts, timeline="blueprint")


@cache
def _eye_descriptors() -> tuple[rr.ComponentDescriptor, ...]:
    """Where it is, what it looks at, what is up."""
    batches = rrb.EyeControls3D(position=(0, 0, 0), look_target=(0, 0, 0), eye_up=(0, 0, 0)).as_component_batches()
    found = {b.component_descriptor().component: b.component_descriptor() for b in batches}
    return tuple(found[f"EyeControls3D:{name}"] for name in ("position", "look_target", "eye_up"))
