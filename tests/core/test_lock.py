"""Lock files: held once, never emptied, never through a link."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import pytest

from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import try_lock, wait_for_lock

BOTH = pytest.mark.parametrize("lock", [try_lock, wait_for_lock])
Lock = Callable[[Path], BinaryIO | None]


@BOTH
def test_what_the_file_holds_stays(lock: Lock, tmp_path: Path) -> None:
    file = tmp_path / "journal"
    file.write_text("a line\n")
    held = lock(file)
    assert held is not None
    with held:
        assert held.read() == b"a line\n"
        assert try_lock(file) is None
    again = try_lock(file)
    assert again is not None
    again.close()


def as_link(file: Path, theirs: Path) -> None:
    file.symlink_to(theirs)


def as_link_to_nothing(file: Path, theirs: Path) -> None:
    file.symlink_to(theirs.with_name("nothing"))


def as_pipe(file: Path, theirs: Path) -> None:
    os.mkfifo(file)


def as_folder(file: Path, theirs: Path) -> None:
    file.mkdir()


@BOTH
@pytest.mark.parametrize("make", [as_link, as_link_to_nothing, as_pipe, as_folder])
def test_what_is_no_file_of_its_own_is_refused(make: Callable[[Path, Path], None], lock: Lock, tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.txt"
    theirs.write_text("years of work")
    make(tmp_path / ".lock", theirs)
    with pytest.raises(InputError, match=r"^cannot write .*\.lock: "):
        lock(tmp_path / ".lock")
    assert theirs.read_text() == "years of work"
    assert not (tmp_path / "nothing").exists()
