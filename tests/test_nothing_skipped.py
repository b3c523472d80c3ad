"""What a missing program does to the tests that need it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.nothing_skipped import NO_DATA, VARIABLE

ROOT = Path(__file__).resolve().parents[1]
POOR = f"""
import pytest

@pytest.fixture
def chromium():
    pytest.skip("no Chromium: apt-get install chromium")

def test_of_the_page(chromium): pass

@pytest.mark.skipif(True, reason="no /dev/full")
def test_of_a_full_disk(): pass

def test_of_real_frames():
    pytest.skip({NO_DATA!r})

@pytest.mark.xfail
def test_of_what_is_known(): assert False
"""


@pytest.mark.usefixtures("processes")
@pytest.mark.parametrize(
    ("required", "counts"), [("", ("3 skipped", "1 xfailed")), ("1", ("1 skipped", "1 xfailed", "2 errors"))]
)
def test_only_real_frames_may_be_missing_where_all_is_required(
    tmp_path: Path, required: str, counts: tuple[str, ...]
) -> None:
    (tmp_path / "test_poor.py").write_text(POOR)
    arguments = ["-p", "tests.nothing_skipped", "-c", os.devnull, "--rootdir", str(tmp_path), "-rfEs", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *arguments], cwd=tmp_path, capture_output=True, text=True, check=False,
        env=os.environ | {VARIABLE: required, "PYTHONPATH": str(ROOT), "COLUMNS": "200"},
    )  # fmt: skip
    assert done.returncode == int(required or 0)
    assert f"{VARIABLE} forbids: no Chromium: apt-get install chromium" in done.stdout or not required
    assert all(count in done.stdout.splitlines()[-1] for count in counts)


def test_make_and_the_ci_require_all() -> None:
    makefile = (ROOT / "Makefile").read_text()
    assert makefile.count(f"{VARIABLE}=1 $(BIN)/python -m pytest") == makefile.count("-m pytest") == 5
    assert re.findall(r"^make (.*)$", (ROOT / ".ci" / "run").read_text(), re.MULTILINE) == [
        "lint", "resolve-lowest", "test-lowest", '-C "$away/verefine_viz" test', "test-data"
    ]  # fmt: skip
