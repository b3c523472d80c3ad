"""``view`` as a process of its own: it prints one address, serves, and ends with Ctrl-C."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from tests.page.recorded import SESSION, record
from verefine_viz.cli import main

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


REFUSED: list[tuple[list[str], str]] = [
    (["--scene.demo", "nope"], "unknown demo scene 'nope'; available: mug"),
    (["--allow-origin", "localhost:3000"], "--allow-origin 'localhost:3000' is no origin"),
    (["--method.refiner", "ipc"], "unknown refiner 'ipc'; did you mean 'icp'? available: icp"),
    (["poses.csv"], "poses.csv does not exist; expected a session (.toml), the folder of a batch run, or a "),
    ([str(ROOT / "README.md")], "README.md cannot be opened; expected a session (.toml), the folder of a batch"),
]


def test_what_does_not_exist_is_said_in_one_line_and_no_address_is_given(capsys: pytest.CaptureFixture[str]) -> None:
    for words, said in REFUSED:
        assert main(["view", *words, "--port", "0", "--no-open-browser"]) == 2
        output, errors = capsys.readouterr()
        assert output == ""
        assert said in errors
        assert errors.count("\n") == 1


def test_recordings_of_two_frames_are_refused_before_an_address_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, elsewhere = record(tmp_path / "one.rrd", SESSION), record(tmp_path / "elsewhere.rrd", SESSION, frame="0/1")
    assert main(["view", str(one), str(elsewhere), "--port", "0", "--no-open-browser"]) == 2
    output, errors = capsys.readouterr()
    assert output == ""
    assert "elsewhere.rrd shows frame 0/1 of mug, seed 0, A shows frame 0/2 of mug, seed 0" in errors
