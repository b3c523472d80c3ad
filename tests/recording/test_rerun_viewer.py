from __future__ import annotations

import subprocess
import urllib.request
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import psutil
import pytest
from PIL import Image

from tests.recording.runs import recorded_run, session
from tests.recording.screenshots import screenshots
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.palette import CLASS_COLORS, STAGE_COLORS
from verefine_viz.recording import rerun_viewer
from verefine_viz.recording.rerun_viewer import open_viewer


@pytest.mark.usefixtures("processes")
def test_viewer_listens_on_loopback_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    recorded_run(tmp_path / "run.rrd")
    viewer = open_viewer(tmp_path / "run.rrd", web=True)
    process = viewer.process
    try:
        addresses = listening(process)
        assert len(addresses) == 2
        assert set(addresses) == {"127.0.0.1"}
        with urllib.request.urlopen(viewer.address, timeout=60) as page:
            assert b"<html" in page.read().lower()
    finally:
        process.kill()
        process.wait()


@pytest.mark.usefixtures("processes")
def test_a_damaged_recording_is_named_here_and_not_in_the_viewers_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[Mapping[str, str]] = []
    monkeypatch.delenv("RUST_LOG", raising=False)
    monkeypatch.setattr(rerun_viewer, "start_viewer", lambda arguments, env: started.append(env))
    path = tmp_path / "run.rrd"
    recorded_run(path)
    assert open_viewer(path, web=False).note == ""
    content = bytearray(path.read_bytes())
    content[len(content) // 3 : len(content) // 3 + 200] = b"\7" * 200
    path.write_bytes(content)
    assert str(path) in open_viewer(path, web=False).note
    assert [env["RUST_LOG"] for env in started] == ["off", "off"]


def listening(process: subprocess.Popen[bytes]) -> list[str]:
    """Addresses that the process listens on, once both servers are up."""
    watched = psutil.Process(process.pid)
    for _ in range(200):
        found = [c.laddr.ip for c in watched.net_connections("tcp") if c.status == psutil.CONN_LISTEN]
        if len(found) >= 2 or process.poll() is not None:
            return found
        try:
            process.wait(0.1)
        except subprocess.TimeoutExpired:
            continue
    return []


@pytest.mark.usefixtures("processes")
def test_the_viewer_shows_the_recording(tmp_path: Path) -> None:
    recorded_run(tmp_path / "run.rrd", session())
    try:
        first, last = screenshots(tmp_path / "run.rrd", (1, 30), tmp_path / "pictures")
    except UnavailableError as error:
        pytest.skip(str(error))
    pixels = np.asarray(Image.open(first).convert("RGB"))
    assert pixels.shape[:2] == (1000, 1600)
    # The fitting pixels of the class map, and the curve of the best score.
    for color in (CLASS_COLORS["explained"], STAGE_COLORS["best"]):
        near = np.abs(pixels.astype(int) - color).max(axis=-1) < 25
        assert near.sum() > 100
    assert (pixels != np.asarray(Image.open(last).convert("RGB"))).any()
