"""``show``: a page of the kernel's own, for what a notebook has at hand."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from urllib.request import urlopen

import pytest

import verefine_viz as vv
from tests.page.conftest import SESSION
from tests.page.fake_tools import FakeTools
from tests.page.made_batch import make_batch, solve
from verefine_viz.core.errors import InputError
from verefine_viz.page import notebook
from verefine_viz.page.app import App
from verefine_viz.recording.verify import first_difference
from verefine_viz.run.run_file import read_run_file, write_record
from verefine_viz.run.session_file import save_session


@pytest.fixture(autouse=True)
def fake_parts(monkeypatch: pytest.MonkeyPatch, processes: None) -> None:
    monkeypatch.setattr(notebook, "App", lambda **given: App(**given, make_tools=FakeTools))  # type: ignore[arg-type]


def test_a_record_a_path_and_a_folder_are_shown_until_the_page_is_closed(tmp_path: Path):
    run = solve(tmp_path / "run.vfrun")
    record = read_run_file(tmp_path / "run.vfrun")
    make_batch(tmp_path / "batch", frames=["0/1"])
    save_session(SESSION, tmp_path / "session.toml")
    shown = {
        "record": record,
        "run": SimpleNamespace(record=record, save=lambda path: write_record(path, record)),
        "file": tmp_path / "run.vfrun",
        "batch": str(tmp_path / "batch"),
        "session": tmp_path / "session.toml",
    }
    for what, given in shown.items():
        page = vv.show(given, height=500)
        assert f'<iframe src="{page.url}"' in page._repr_html_()
        assert "height: 500px" in page._repr_html_()
        assert page.url.startswith("http://127.0.0.1:")
        with urlopen(page.url) as answer:
            assert "frame-ancestors 'self' http://localhost:*" in answer.headers["content-security-policy"]
        first = page._app.debugger.space.work.first
        assert first.run.length == (0 if what == "session" else run.length), what
        if what in ("record", "file"):
            assert first_difference(first.run.iterations, record.iterations) is None
        page.close()
        page.close()
        # Not by asking the address: another test may have got the port.
        server = page._app.server
        assert (server._socket.fileno(), server._thread.is_alive()) == (-1, False)


def test_what_cannot_be_shown_is_said(tmp_path: Path):
    for given, why in ((7, "7 cannot be shown, expected"), (tmp_path / "none.vfrun", "none.vfrun does not exist")):
        with pytest.raises(InputError, match=why):
            vv.show(given)


@pytest.mark.usefixtures("processes")
def test_open3d_prints_no_banner_into_a_notebook_and_starts_no_server() -> None:
    program = """
import builtins
class ZMQInteractiveShell: pass
builtins.get_ipython = lambda: ZMQInteractiveShell()
import verefine_viz.observation.support_plane
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100, check=True)
    assert (done.stdout, done.stderr) == ("", "")
