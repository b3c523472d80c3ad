"""The rerun viewer as a separate process, reachable from this machine only."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import rerun_cli

from verefine_viz.core.errors import UnavailableError

LOOPBACK = "127.0.0.1"


def executable() -> Path:
    """The viewer that the rerun package brings along.

    Raises:
        UnavailableError: it is not there.
    """
    # The console script only starts this one as a child, which would outlive it.
    path = Path(rerun_cli.__file__).parent / ("rerun.exe" if os.name == "nt" else "rerun")
    if not path.exists():
        raise UnavailableError(f"the rerun viewer is not installed ({path} is missing); pip install rerun-sdk")
    return path


def start_viewer(arguments: Sequence[str], env: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
    """Starts the viewer with ``arguments``, bound to 127.0.0.1 on a free port unless they name one."""
    command = [str(executable()), *arguments, "--bind", LOOPBACK]
    if "--port" not in arguments:
        command += ["--port", str(free_port())]
    return subprocess.Popen(command, env=None if env is None else dict(env))


def free_port() -> int:
    """A port of 127.0.0.1 that nobody uses right now."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def has_display() -> bool:
    """Whether a window can be opened here."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
