"""A recording in the rerun viewer, a separate process that is reachable from this machine only."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from verefine_viz.recording.drawn_iterations import Drawing
from verefine_viz.recording.entities import MAPS, SCENE_MAPS, SEQUENCE_FILE
from verefine_viz.recording.reader import Recorded, existing, final_path, has_content, read_recording
from verefine_viz.recording.recording_file import COMPLETE, RecordingFile, executable, saved_chunks
from verefine_viz.recording.views import blueprint_of

LOOPBACK = "127.0.0.1"


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
    if path.name != SEQUENCE_FILE:
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
    # The page alone would be empty: its address says where the recording comes from.
    source = quote(f"rerun+http://{LOOPBACK}:{data}/proxy", safe="")
    return OpenViewer(start_viewer(arguments, env), f"http://{LOOPBACK}:{page}?url={source}")


def completed(recorded: Recorded, folder: Path) -> Path:
    """A copy of an unfinished recording in ``folder``, with all its iterations drawn.

    Raises:
        InputError: the disk does not take it.
    """
    target = folder / final_path(recorded.path).name
    chunks = saved_chunks(recorded.path)[0] if has_content(recorded.path) else []
    maps = [chunk for chunk in chunks if chunk.entity_path.startswith((f"{MAPS}/", f"{SCENE_MAPS}/"))]
    file = RecordingFile(target)
    about = {name: text for name, text in recorded.properties.items() if name != COMPLETE}
    file.send_properties(about, f"{recorded.title} {recorded.frame} {recorded.session.method.name}")
    file.send_blueprint(blueprint_of(recorded.layout, bool(maps), recorded.session.score.colour_weight > 0))
    drawing = Drawing(recorded.layout)
    drawing.start(file)
    # What was drawn may end anywhere in a block of iterations, so all of them are drawn again.
    fixed = [c for c in chunks if c.is_static and not c.entity_path.startswith("/__properties")]
    file.send_chunks([*fixed, *(chunk for chunk in maps if not chunk.is_static)])
    if recorded.entries:
        drawing.draw(file, recorded.entries)
    file.close(len(recorded.entries))
    return target


def start_viewer(arguments: Sequence[str], env: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
    """Starts the viewer with ``arguments``, bound to 127.0.0.1 on a free port unless they name one."""
    command = [str(executable()), *arguments, "--bind", LOOPBACK]
    if "--port" not in arguments:
        command += ["--port", str(free_port())]
    return subprocess.Popen(command, env=None if env is None else dict(env))


def free_port() -> int:
    """A port of 127.0.0.1 that is not in use right now."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def has_display() -> bool:
    """Whether a window can be opened here."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
