"""Ctrl-C and SIGTERM in the middle of long commands: one line, no traceback, no process left.

Those of a batch are in tests/batch/test_batch.py.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path
from time import sleep

import psutil
import pytest

from verefine_viz import cli
from verefine_viz.run.kernel_compilation import COMPILING

ROOT = Path(__file__).resolve().parents[2]
NEVER_CANCELLED = """
[scene]
demo = "duck"
model_points = 200
[hypotheses]
source = "pcs"
[pcs]
bases = 1000000
"""


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(("command", "number"), [("estimate", signal.SIGINT), ("study", signal.SIGTERM)])
def test_a_command_in_the_middle_of_its_work_says_one_line_and_leaves_nothing_running(
    command: str, number: signal.Signals, tmp_path: Path
) -> None:
    (tmp_path / "endless.toml").write_text(NEVER_CANCELLED)
    words = {
        "estimate": ["estimate", "endless.toml", "--out", "out.csv", "--workers", "2"],
        "study": ["study", "robustness", "--out", "out", "--workers", "2", "--scene.demo", "duck"],
    }[command]
    begun = {"estimate": "out.csv.journal/run.json", "study": "out/robustness.journal/study.json"}
    child = subprocess.Popen(
        [sys.executable, "-m", "verefine_viz.cli", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True,
    )  # fmt: skip
    with child:
        try:
            while child.poll() is None and not is_at_work(child.pid, tmp_path / begun[command]):
                sleep(0.05)
            workers = psutil.Process(child.pid).children(recursive=True)
            os.killpg(child.pid, number)
            output, errors = child.communicate(timeout=200)
        finally:
            child.kill()
    *first, last = errors.removeprefix(f"{COMPILING}\n").splitlines()
    assert (child.returncode, last) == (128 + number, "stopped")
    # A study whose first answers were there by then says how many, and shows what they say.
    if first:
        (line,) = first
        assert command == "study"
        assert re.fullmatch(
            r"study robustness: stopped after \d+ of 100 runs; writing them, the same command goes on", line
        )
        assert "claims: robustness.md" in output
    else:
        assert output == ""
    _, alive = psutil.wait_procs(workers, timeout=100)
    assert alive == []


def test_what_is_ignored_stays_ignored_and_a_second_signal_is() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with pytest.raises(cli.Stopped) as stop, cli.stopped_by_signals():
            os.kill(os.getpid(), signal.SIGHUP)
            try:
                os.kill(os.getpid(), signal.SIGTERM)
            finally:
                os.kill(os.getpid(), signal.SIGTERM)  # while it tidies up; as timeout(1) sends it
                os.kill(os.getpid(), signal.SIGINT)
        assert stop.value.signal == signal.SIGTERM
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def is_at_work(pid: int, begun: Path) -> bool:
    """Whether the command's workers are there, and busy."""
    try:
        children = psutil.Process(pid).children(recursive=True)
        return begun.is_file() and any(child.cpu_times().user > 2 for child in children)
    except psutil.NoSuchProcess:
        return False
