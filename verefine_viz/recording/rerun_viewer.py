"""A recording in the rerun viewer, a separate process that is reachable from this machine only."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from verefine_viz.recording.reader import check_rerun_file
from verefine_viz.recording.recording_file import executable, is_whole

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class OpenViewer:
    """A rerun viewer that shows a recording."""

    process: subprocess.Popen[bytes]
    address: str
    """The address to type into a browser; empty = the viewer has a window of its own."""
    note: str = ""
    """A note on what is wrong with the recording."""


def open_viewer(path: Path, web: bool | None = None) -> OpenViewer:
    """Opens a recording in the rerun viewer, which is reachable from this machine only.

    Args:
        path: the recording.
        web: in the browser; None = where no window can be opened.

    Raises:
        InputError: it is not a recording of this program.
        UnavailableError: the viewer is not installed.
    """
    check_rerun_file(path)
    note = "" if is_whole(path) else f"{path} is damaged; the viewer shows what can be read of it"
    # The viewer's own coloured lines would bury ours.
    env = {"RUST_LOG": "off", "NO_COLOR": "1", **os.environ}
    in_browser = not has_display() if web is None else web
    if not in_browser:
        return OpenViewer(start_viewer([str(path)], env), "", note)
    page, data = free_port(), free_port()
    arguments = [str(path), "--web-viewer", "--web-viewer-port", str(page), "--port", str(data)]
    # The page alone would be empty: its address says where the recording comes from.
    source = quote(f"rerun+http://{LOOPBACK}:{data}/proxy", safe="")
    return OpenViewer(start_viewer(arguments, env), f"http://{LOOPBACK}:{page}?url={source}", note)


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
