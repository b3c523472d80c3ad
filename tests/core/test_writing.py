"""Writing: whole or not at all, never through a link, by one process at a time; places that cannot be written to."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import BinaryIO

import pytest

from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import (
    atomic,
    check_file,
    check_folder,
    expand_home,
    path_fault,
    try_lock,
    wait_for_lock,
)


def write(path: Path, text: str) -> None:
    with atomic(path) as part:
        part.write_text(text)


def test_files_appear_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "a" / "f.txt"
    with atomic(path) as part:
        part.write_text("one")
        assert not path.exists()
    assert path.read_text() == "one"
    with pytest.raises(ZeroDivisionError), atomic(path) as part:
        part.write_text("two")
        raise ZeroDivisionError
    assert path.read_text() == "one"
    with pytest.raises(InputError, match=r"below\.txt"):
        write(path / "below.txt", "three")
    assert [p.name for p in path.parent.iterdir()] == ["f.txt"]


def test_two_writers_of_a_file_do_not_share_what_is_half_written(tmp_path: Path) -> None:
    path = tmp_path / "f.txt"
    with atomic(path) as part, ThreadPoolExecutor(1) as other:
        part.write_text("mine")
        other.submit(write, path, "theirs").result()
        assert path.read_text() == "theirs"
    assert path.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [path]


# Places that cannot be written to: the part of the path that is wrong is named, and nothing is left behind.


@pytest.fixture
def nobody() -> Iterator[None]:
    """Somebody who may not write everywhere, as root may."""
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    yield
    os.seteuid(before)


def check_refused(path: Path, named: Path) -> None:
    """Checks that neither a folder nor a file below it can be made, and that one part of the path is named."""
    for check in (lambda: check_folder(path), lambda: check_file(path / "a.html", "a.html")):
        with pytest.raises(InputError, match=f"^cannot write to --out {path}.*{named}"):
            check()


def test_the_part_of_a_path_that_is_in_the_way_is_named(tmp_path: Path) -> None:
    file, link = tmp_path / "thesis.tex", tmp_path / "disk"
    file.write_text("precious")
    link.symlink_to("/no/such/disk")
    check_refused(file / "a" / "b", file)
    check_refused(link / "runs", link)
    check_refused(Path("/proc/runs/today"), Path("/proc"))  # It refuses even root.
    with pytest.raises(InputError, match=f"{file} is a file"):
        write(file / "a.csv", "")
    assert {*tmp_path.iterdir()} == {file, link}
    assert file.read_text() == "precious"


def test_below_a_folder_of_somebody_else(nobody: None) -> None:
    # What is above it may be looked into by its owner only, and then it is that folder which is named.
    place = Path("/root/.hidden") if Path("/root").is_dir() else Path("/")
    with pytest.raises(InputError, match="Permission denied"):
        check_folder(place / "runs" / "today")


def test_a_relative_path_is_named_by_where_it_begins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert f"{tmp_path} is a folder" in path_fault(Path("runs/today"), PermissionError(errno.EACCES, "denied"))
    assert path_fault(tmp_path / "a", OSError(errno.ENOSPC, "No space left on device")) == "No space left on device"


def test_what_is_no_file_or_no_folder_keeps_its_place(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "f").write_text("")
    for refused in (
        lambda: check_folder(tmp_path / "f"),
        lambda: check_file(tmp_path, "r.html"),
        lambda: write(tmp_path, ""),
        *(
            do
            for special in (tmp_path / "pipe", Path("/dev/null"))
            for do in (lambda path=special: write(path, ""), lambda path=special: check_file(path, "a.html"))
        ),
    ):
        with pytest.raises(InputError):
            refused()
    assert not (tmp_path / "pipe").is_file()
    assert {path.name for path in tmp_path.iterdir()} == {"pipe", "f"}


def test_nothing_is_left_of_a_place_that_will_do(tmp_path: Path) -> None:
    check_folder(tmp_path / "a" / "b")
    check_file(tmp_path / "c" / "d.csv", "d.csv")
    check_file(tmp_path / "e.csv", "e.csv")
    assert list(tmp_path.iterdir()) == []


def test_the_home_folder_is_meant_by_a_tilde(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert (expand_home("~"), expand_home("~/a")) == (tmp_path, tmp_path / "a")
    for other in ("a~", "a/~/b", "~nobody-of-this-name/a"):
        assert expand_home(other) == Path(other)


# Lock files: held once, never emptied, never through a link.


BOTH = pytest.mark.parametrize("lock", [try_lock, wait_for_lock])
Lock = Callable[[Path], BinaryIO | None]
IN_THE_WAY: dict[str, Callable[[Path, Path], object]] = {
    "a link": lambda file, theirs: file.symlink_to(theirs),
    "a link to nothing": lambda file, theirs: file.symlink_to(theirs.with_name("nothing")),
    "a pipe": lambda file, theirs: os.mkfifo(file),
    "a folder": lambda file, theirs: file.mkdir(),
}


@BOTH
def test_a_lock_is_held_once_and_what_the_file_holds_stays(lock: Lock, tmp_path: Path) -> None:
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


@BOTH
@pytest.mark.parametrize("make", IN_THE_WAY.values(), ids=IN_THE_WAY)
def test_a_lock_that_is_no_file_of_its_own_is_refused(
    make: Callable[[Path, Path], object], lock: Lock, tmp_path: Path
) -> None:
    theirs = tmp_path / "theirs.txt"
    theirs.write_text("years of work")
    make(tmp_path / ".lock", theirs)
    with pytest.raises(InputError, match=r"\.lock"):
        lock(tmp_path / ".lock")
    assert theirs.read_text() == "years of work"
    assert not (tmp_path / "nothing").exists()
