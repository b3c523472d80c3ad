"""Pictures of a recording as the rerun viewer shows it, without a screen (needs a Vulkan driver, Mesa's will do)."""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from rerun.experimental import ViewerClient

from verefine_viz.core.errors import UnavailableError
from verefine_viz.recording.entities import TIMELINE
from verefine_viz.recording.rerun_viewer import LOOPBACK, free_port, start_viewer

LOAD_S = 60.0


def screenshots(
    recording: Path,
    iterations: Sequence[int],
    out: Path,
    size_px: tuple[int, int] = (1600, 1000),
    timeline: str = TIMELINE,
) -> tuple[Path, ...]:
    """One PNG per iteration, or whatever the timeline counts, in the folder ``out``, as the viewer shows it.

    Raises:
        UnavailableError: the viewer does not start here.
    """
    out.mkdir(parents=True, exist_ok=True)
    port = free_port()
    with tempfile.TemporaryDirectory() as home:
        # The viewer keeps settings below HOME, which would carry over from one picture to the next.
        env = {**os.environ, "HOME": home, "XDG_DATA_HOME": home, "XDG_CONFIG_HOME": home, "RUST_LOG": "error"}
        arguments = ["--headless", "--port", str(port), "--window-size", f"{size_px[0]}x{size_px[1]}"]
        process = start_viewer([*arguments, "--hide-welcome-screen"], env)
        try:
            client = _connect(port, process)
            client.open(str(recording.resolve()))
            _wait(lambda: not client.get_state().loading, process)
            pictures = []
            for k in iterations:
                client.set_time(timeline, sequence=k, play_state="paused")
                picture = out / f"{recording.stem}_{k:04d}.png"
                # The first picture after a jump in time can lack what is still being decoded.
                client.take_screenshot()
                client.save_screenshot(str(picture.resolve()))
                pictures.append(picture)
            return tuple(pictures)
        finally:
            process.kill()
            process.wait()


def _connect(port: int, process: subprocess.Popen[bytes]) -> ViewerClient:
    clients: list[ViewerClient] = []

    def answers() -> bool:
        try:
            client = ViewerClient.connect(f"rerun+http://{LOOPBACK}:{port}/proxy")
            client.get_state()
        except (RuntimeError, ConnectionError, ValueError):
            return False
        clients.append(client)
        return True

    _wait(answers, process)
    return clients[0]


def _wait(ready: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + LOAD_S
    while not ready():
        if process.poll() is not None:
            raise UnavailableError("the rerun viewer does not start; it needs a Vulkan driver: mesa-vulkan-drivers")
        if time.monotonic() > end:
            raise UnavailableError(f"the rerun viewer did not answer within {LOAD_S:.0f} s")
        time.sleep(0.05)
