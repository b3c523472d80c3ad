"""A recording in the rerun viewer."""

from __future__ import annotations

import os
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from rerun.chunk import Chunk

from verefine_viz.recording.blueprint import blueprint_messages
from verefine_viz.recording.drawing import Drawing
from verefine_viz.recording.entities import MAPS, SCENE_MAPS
from verefine_viz.recording.frame import property_chunks
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.reader import (
    PROPERTIES,
    Recorded,
    existing,
    final_path,
    has_content,
    read_recording,
    saved_chunks,
)
from verefine_viz.recording.rrd_file import RrdFile
from verefine_viz.recording.viewer_process import LOOPBACK, free_port, has_display, start_viewer


@dataclass(frozen=True)
class OpenViewer:
    """A rerun viewer that shows a recording."""

    process: subprocess.Popen[bytes]
    address: str
    """What to type into a browser; empty = it is a window of its own."""


def open_viewer(path: Path, web: bool | None = None) -> OpenViewer:
    """Opens a recording in the rerun viewer, which is reachable from this machine only.

    Args:
        path: the recording; one of a killed run is completed into a temporary copy first.
        web: in the browser; None = where no window can be opened.

    Raises:
        InputError: it is not a recording of this program.
        UnavailableError: the viewer is not installed.
    """
    path = existing(path)
    recorded = read_recording(path)
    if not recorded.is_complete:
        path = completed(recorded, Path(tempfile.mkdtemp(prefix="verefine-")))
    # Its own lines of progress would bury ours.
    env = {"RUST_LOG": "warn", **os.environ}
    in_browser = not has_display() if web is None else web
    if not in_browser:
        return OpenViewer(start_viewer([str(path)], env), "")
    page, data = free_port(), free_port()
    arguments = [str(path), "--web-viewer", "--web-viewer-port", str(page), "--port", str(data)]
    # The page alone would be empty: it has to be told where the recording comes from.
    source = quote(f"rerun+http://{LOOPBACK}:{data}/proxy", safe="")
    return OpenViewer(start_viewer(arguments, env), f"http://{LOOPBACK}:{page}?url={source}")


def completed(recorded: Recorded, folder: Path) -> Path:
    """A copy of an unfinished recording in ``folder``, with all its iterations drawn."""
    target = folder / final_path(recorded.path).name
    chunks: list[Chunk] = []
    if has_content(recorded.path):
        chunks, _ = saved_chunks(recorded.path)
    has_maps = any(_is_map(chunk) for chunk in chunks)
    drawing = Drawing(recorded.layout)
    file = RrdFile(target)
    if not any(chunk.entity_path == PROPERTIES for chunk in chunks):
        file.send(property_chunks(recorded.properties))
    file.send(drawing.start())
    # What was drawn may end anywhere in a block of iterations, so all of them are drawn again.
    file.send(Piece.of(chunk) for chunk in chunks if chunk.is_static or _is_map(chunk))
    if recorded.entries:
        file.send(drawing.draw(recorded.entries))
    file.close(blueprint_messages(recorded.layout, has_maps))
    return target


def _is_map(chunk: Chunk) -> bool:
    return chunk.entity_path.startswith((f"{MAPS}/", f"{SCENE_MAPS}/"))
