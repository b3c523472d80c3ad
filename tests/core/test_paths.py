"""Places that cannot be written to: the part of the path that is wrong is named, and nothing is left behind."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from verefine_viz.core.errors import InputError
from verefine_viz.core.writing import atomic, check_file, check_folder, expand_home, path_fault


@pytest.fixture
def nobody() -> Iterator[None]:
    """Somebody who may not write everywhere, as root may."""
    before = os.geteuid()
    if before == 0:
        os.seteuid(65534)
    yield
    os.seteuid(before)


def said(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        check_folder(path)
    with pytest.raises(InputError) as of_file:
        check_file(path / "a.html", "a.html")
    lines = [str(caught.value), str(of_file.value)]
    start, end = f"cannot write to --out {path}", "; choose another --out"
    assert lines[0].startswith(f"{start}: ")
    assert lines[1].startswith(f"{start}/a.html: ")
    whys = {line.partition(": ")[2].removesuffix(end) for line in lines if line.endswith(end)}
    assert len(whys) == 1, lines
    return whys.pop()


def test_below_a_file(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    assert said(tmp_path / "thesis.tex" / "a" / "b") == f"{tmp_path / 'thesis.tex'} is a file, not a folder"
    refused = pytest.raises(InputError, match=r"a\.csv: .*thesis\.tex is a file, not a folder$")
    with refused, atomic(tmp_path / "thesis.tex" / "a.csv") as part:
        part.write_text("")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("name", ["/dev/null", "pipe"])
def test_a_device_or_a_pipe_keeps_its_place(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    path = tmp_path / name
    with pytest.raises(InputError, match="is a device or a pipe, expected"), atomic(path) as part:
        part.write_text("")
    with pytest.raises(InputError, match=r"is a device or a pipe, expected the name of a file, for example a\.html"):
        check_file(path, "a.html")
    assert not path.is_file()
    assert [p.name for p in tmp_path.iterdir()] == ["pipe"]


def test_below_a_folder_of_somebody_else(tmp_path: Path, nobody: None) -> None:
    # What is above it may be looked into by its owner only, and then it is that folder which is named.
    place = Path("/root/.hidden") if Path("/root").is_dir() else Path("/")
    assert said(place / "runs" / "today").startswith("no permission to write in /")


def test_below_a_folder_without_write_permission(tmp_path: Path) -> None:
    error = PermissionError(errno.EACCES, "Permission denied")
    assert path_fault(tmp_path / "a" / "b", error) == f"no permission to write in {tmp_path}"
    (tmp_path / "f").write_text("")
    assert path_fault(tmp_path / "f", error) == f"no permission to write {tmp_path / 'f'}"
    read_only = OSError(errno.EROFS, "Read-only file system")
    assert path_fault(tmp_path / "a" / "b", read_only) == f"{tmp_path} is read-only"


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs /proc")
def test_where_the_system_takes_no_files() -> None:
    # /proc refuses even root.
    assert said(Path("/proc/runs/today")).endswith(" /proc (No such file or directory)")


def test_a_link_to_nothing(tmp_path: Path) -> None:
    (tmp_path / "disk").symlink_to("/no/such/disk")
    why = f"{tmp_path / 'disk'} is a link to /no/such/disk, which does not exist"
    assert said(tmp_path / "disk" / "runs") == why


def test_a_file_and_a_folder_mistaken_for_each_other(tmp_path: Path) -> None:
    (tmp_path / "f").write_text("")
    with pytest.raises(InputError, match=r"^--out .*/f is a file, expected a folder$"):
        check_folder(tmp_path / "f")
    with pytest.raises(InputError, match=r"^--to .* is a folder, expected the name of a file, for example .*/r\.html$"):
        check_file(tmp_path, "r.html", "--to")
    with pytest.raises(InputError, match=r"is a folder$"), atomic(tmp_path) as part:
        part.write_text("")


def test_a_name_without_a_folder_is_below_where_one_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    error = PermissionError(errno.EACCES, "Permission denied")
    assert path_fault(Path("runs/today"), error) == f"no permission to write in {tmp_path}"


def test_what_is_not_about_the_place_is_said_as_the_system_does(tmp_path: Path) -> None:
    assert path_fault(tmp_path / "a", OSError(errno.ENOSPC, "No space left on device")) == "No space left on device"


def test_the_home_folder_is_meant_by_a_tilde(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert (expand_home("~"), expand_home("~/a")) == (tmp_path, tmp_path / "a")
    for other in ("a~", "a/~/b", "~nobody-of-this-name/a"):
        assert expand_home(other) == Path(other)


def test_nothing_is_left_of_a_place_that_will_do(tmp_path: Path) -> None:
    check_folder(tmp_path / "a" / "b")
    check_file(tmp_path / "c" / "d.csv", "d.csv")
    check_file(tmp_path / "e.csv", "e.csv")
    assert list(tmp_path.iterdir()) == []
