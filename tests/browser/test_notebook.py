"""The page in a cell of a real notebook."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest

from tests.browser.conftest import SESSIONS, SIZE, SLOW_MS
from verefine_viz.recording.rerun_viewer import free_port

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def notebook(tmp_path: Path):
    """Serve a notebook whose one cell shows a session; give its address and the file."""
    pytest.importorskip("notebook", reason="no notebook server: pip install notebook")
    source = f"import verefine_viz as vv\nvv.show({str(SESSIONS / 'mug.toml')!r}, height=600)"
    cell = {"cell_type": "code", "source": source, "metadata": {}, "outputs": [], "execution_count": None, "id": "a"}
    spec = {"name": "python3", "display_name": "Python 3", "language": "python"}
    book = {"cells": [cell], "metadata": {"kernelspec": spec}, "nbformat": 4, "nbformat_minor": 5}
    (tmp_path / "debug.ipynb").write_text(json.dumps(book))
    port = free_port()
    homes = {f"JUPYTER_{name}_DIR": str(tmp_path / name) for name in ("CONFIG", "DATA", "RUNTIME")}
    command = [sys.executable, "-m", "notebook", "--no-browser", f"--port={port}", "--ip=127.0.0.1", "--allow-root",
               "--IdentityProvider.token=", f"--ServerApp.root_dir={tmp_path}"]  # fmt: skip
    environment = {**os.environ, **homes, "PYTHONPATH": str(ROOT)}
    log = (tmp_path / "log").open("w")
    server = subprocess.Popen(command, cwd=tmp_path, env=environment, stdout=log, stderr=log)
    address = f"http://127.0.0.1:{port}"
    try:
        for _ in range(400):
            try:
                urllib.request.urlopen(f"{address}/api", timeout=2).close()
                break
            except OSError:
                time.sleep(0.1)
        yield address
    finally:
        server.terminate()
        server.wait(20)
        log.close()


def test_page_is_shown_in_a_cell_and_closed_with_the_kernel(chromium, notebook):
    page = chromium.new_page(viewport=SIZE)
    page.goto(f"{notebook}/notebooks/debug.ipynb")
    page.locator(".jp-Cell").first.click(timeout=SLOW_MS)
    page.keyboard.press("Shift+Enter")
    frame = page.frame_locator("iframe")
    frame.get_by_role("button", name="Step", exact=True).click(timeout=SLOW_MS)
    frame.get_by_text("of 25").first.wait_for(timeout=SLOW_MS)
    address = page.locator("iframe").first.get_attribute("src", timeout=SLOW_MS)
    assert address is not None
    assert address.startswith("http://127.0.0.1:")
    with urllib.request.urlopen(address, timeout=5) as answer:
        assert answer.status == 200
    kernels = json.load(urllib.request.urlopen(f"{notebook}/api/kernels", timeout=5))
    request = urllib.request.Request(f"{notebook}/api/kernels/{kernels[0]['id']}", method="DELETE")
    cookie = {c["name"]: c["value"] for c in page.context.cookies()}.get("_xsrf", "")
    request.add_header("Cookie", f"_xsrf={cookie}")
    request.add_header("X-XSRFToken", cookie)
    urllib.request.urlopen(request, timeout=20).close()
    for _ in range(200):
        try:
            urllib.request.urlopen(address, timeout=2).close()
            time.sleep(0.1)
        except OSError:
            break
    else:
        raise AssertionError("the page outlives its kernel")
    page.close()
