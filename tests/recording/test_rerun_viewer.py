from __future__ import annotations

import subprocess
import urllib.request
from pathlib import Path

import psutil
import pytest

from tests.recording.runs import recorded_run
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
