"""``view`` as a process of its own: it prints one address, serves, and ends with Ctrl-C."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

pytestmark = pytest.mark.usefixtures("processes")

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_page_is_served_until_ctrl_c_or_a_signal_to_end(number: signal.Signals, tmp_path: Path) -> None:
    program = [sys.executable, str(ROOT / "app.py"), "--port", "0", "--no-open-browser"]
    child = subprocess.Popen(
        program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True
    )
    with child:
        line = child.stdout.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+", line)
        assert found, line + child.communicate()[1]
        with urllib.request.urlopen(found.group(), timeout=60) as answer:
            assert answer.status == 200
            assert b"<html" in answer.read().lower()
        child.send_signal(number)
        output, errors = child.communicate(timeout=120)
    assert child.returncode == (0 if number == signal.SIGINT else 128 + number), errors
    assert output == ""
    assert "Traceback" not in errors
