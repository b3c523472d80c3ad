"""Ctrl-C in the middle of long commands: one line, no traceback, no process left, and what was finished stays."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from time import sleep

import psutil
import pytest

ROOT = Path(__file__).resolve().parents[2]
ENDLESS = """
[scene]
demo = "duck"
model_points = 200
[hypotheses]
source = "pcs"
[pcs]
bases = 1000000
"""


@pytest.mark.parametrize("command", ["estimate", "batch", "study"])
def test_a_command_in_the_middle_of_its_work_says_one_line_and_leaves_nothing_running(
    command: str, tmp_path: Path
) -> None:
    (tmp_path / "endless.toml").write_text(ENDLESS)
    words = {
        "estimate": ["estimate", "endless.toml", "--out", "out.csv", "--workers", "2"],
        "batch": ["batch", "endless.toml", "--out", "out", "--workers", "2"],
        "study": ["study", "robustness", "--out", "out", "--workers", "2", "--scene.demo", "duck"],
    }[command]
    begun = {"estimate": "out.csv.journal/run.json", "batch": "out/run.json", "study": "out/robustness.journal.jsonl"}
    child = subprocess.Popen(
        [sys.executable, "-m", "verefine_viz.cli", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, start_new_session=True,
    )  # fmt: skip
    with child:
        try:
            while child.poll() is None and not is_at_work(child.pid, tmp_path / begun[command]):
                sleep(0.05)
            workers = psutil.Process(child.pid).children(recursive=True)
            os.killpg(child.pid, signal.SIGINT)
            output, errors = child.communicate(timeout=200)
        finally:
            child.kill()
    assert (child.returncode, output, errors) == (130, "", "stopped\n")
    _, alive = psutil.wait_procs(workers, timeout=100)
    assert alive == []


def is_at_work(pid: int, begun: Path) -> bool:
    """Whether the command's workers are there, and busy."""
    try:
        children = psutil.Process(pid).children(recursive=True)
        return begun.is_file() and any(child.cpu_times().user > 2 for child in children)
    except psutil.NoSuchProcess:
        return False
