"""A recording that rerun viewers can watch while it is written."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import rerun as rr

from verefine_viz.recording.blueprint import blueprint_of
from verefine_viz.recording.entities import APPLICATION
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.piece import Piece


class LiveFile:
    """Writes chunks to a file and serves them on a port of 127.0.0.1, each as soon as it is sent."""

    def __init__(self, path: Path, port: int, layout: Layout, has_maps: bool) -> None:
        """Opens the port.

        Raises:
            RuntimeError: the file cannot be written, or the port is taken.
        """
        self._stream = rr.RecordingStream(APPLICATION, send_properties=False)
        self._stream.set_log_time_enabled(False)
        self._stream.set_sinks(rr.FileSink(path), rr.GrpcServerSink(bind_ip="127.0.0.1", port=port))
        self._stream.send_blueprint(blueprint_of(layout, has_maps), make_active=False)

    def send(self, pieces: Iterable[Piece]) -> None:
        """Hands over chunks; they are on disk when this returns."""
        self._stream.send_chunks([chunk for piece in pieces for chunk in piece.chunks])
        self._stream.flush()

    def flush(self) -> None:
        """Nothing waits here."""

    def close(self, blueprint: bytes) -> None:
        """Completes the file; the blueprint is in it since the beginning."""
        self._stream.disconnect()
