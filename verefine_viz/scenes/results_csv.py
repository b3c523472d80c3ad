"""BOP results files: ``scene_id,im_id,obj_id,score,R,t,time``, one estimated pose a line, millimetres.

:func:`read_lines` accepts the lines that the official toolkit's format check accepts; a byte order mark is skipped.
:func:`read_poses` wants more: poses and scores must be numbers and R near a rotation. A line that cannot be used is
left out, and a note names the first.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ContentError, InputError, quoted
from verefine_viz.core.files import reading
from verefine_viz.core.geometry import as_rigid, rounding_note, transform
from verefine_viz.core.text_format import unusable
from verefine_viz.core.writing import atomic

HEADER = "scene_id,im_id,obj_id,score,R,t,time"


@dataclass(frozen=True, eq=False)
class ResultRow:
    """One estimate."""

    scene_id: int
    im_id: int
    obj_id: int
    score: float
    T_cam_obj: Float
    """(4, 4) [m]."""
    time_s: float = -1.0
    """Seconds for the whole image; negative = unknown."""


@dataclass(frozen=True, eq=False)
class ResultLine:
    """One estimate as in the file: any nine and three numbers."""

    number: int
    """Number of the line in its file, from 1."""
    scene_id: int
    im_id: int
    obj_id: int
    score: float
    R: Float
    """(3, 3), not necessarily a rotation."""
    t_mm: Float
    """(3,) [mm]."""
    time_s: float


@dataclass(frozen=True, eq=False)
class ResultLines:
    """The lines of a file."""

    lines: tuple[ResultLine, ...]
    faults: Mapping[int, str]
    """What is wrong with each line that is left out, by line number."""
    other_times: tuple[str, ...]
    """Lines whose time differs from that of the first line of their image, which is the one that counts."""

    def time_notes(self, path: Path) -> tuple[str, ...]:
        """A note about the times of the file at ``path``."""
        if not self.other_times:
            return ()
        n = len(self.other_times)
        which = "row states another time than" if n == 1 else "rows state other times than"
        return (
            f"{n} {which} the first row of the image, which counts{'; the first' * (n > 1)}: {self.other_times[0]}"
            f" ({path.name})",
        )


@dataclass(frozen=True, eq=False)
class Estimates:
    """The estimates of a results file of any format, in the file's order."""

    rows: tuple[ResultRow, ...]
    left_out: tuple[str, ...] = ()
    """A note about rows that cannot be used: how many, and what is wrong with the first."""
    rounded: tuple[str, ...] = ()
    """A note about rounded rotations."""

    @property
    def notes(self) -> tuple[str, ...]:
        """All notes."""
        return self.left_out + self.rounded


def read_poses(path: Path | str) -> Estimates:
    """The estimates of a results file.

    Raises:
        InputError: as :func:`read_lines`, or no line holds a pose; the first line's number and the reason are named.
    """
    path = Path(path)
    read = read_lines(path)
    faults = {**read.faults}
    rows: list[ResultRow] = []
    taken: list[Float] = []
    for line in read.lines:
        try:
            rows.append(_row(line))
            taken.append(line.R)
        except ValueError as error:
            faults[line.number] = str(error)
    in_order = [faults[number] for number in sorted(faults)]
    if not rows:
        raise InputError(f"{path}: {in_order[0]}")
    return Estimates(tuple(rows), unusable("row", path.name, in_order), rounding_note(path.name, taken))


def read_results(path: Path | str) -> tuple[ResultRow, ...]:
    """All estimates of a file that this program wrote, and may write again.

    Raises:
        InputError: as :func:`read_poses`, or a line holds no pose and would be lost.
    """
    read = read_poses(path)
    if read.left_out:
        raise InputError(f"{path}: {read.left_out[0]}")
    return read.rows


def read_lines(path: Path | str) -> ResultLines:
    """The lines of a results file that the official format check accepts, with what is wrong with the others.

    Raises:
        InputError: the file is missing or empty, has another header, or no line can be used; the number of the first
            and the reason are named.
    """
    path = Path(path)
    with reading(path) as file:
        return _lines_of(file.read(), path)


def _lines_of(raw: bytes, path: Path) -> ResultLines:
    try:
        # Line breaks of any system, as Python reads text.
        text = raw.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise ContentError(f"no text file, expected a BOP results CSV ({HEADER})") from None
    lines = text.split("\n")
    if lines[-1] == "":
        lines.pop()
    estimates: list[ResultLine] = []
    faults: dict[int, str] = {}
    other_times: list[str] = []
    first_time: dict[tuple[int, int], float] = {}
    for number, line in enumerate(lines, start=1):
        if number == 1 and HEADER in line:
            continue
        where = f"line {number}"
        if number == 1 and _is_header(line):
            raise ContentError(f"{where}: the header is {quoted(line.strip())}, expected {HEADER} or none{_hint(path)}")
        try:
            new = _line_of(line, number, where)
        except ValueError as error:
            faults[number] = str(error)
            continue
        known = new.time_s if new.time_s < 0 else first_time.setdefault((new.scene_id, new.im_id), new.time_s)
        if abs(new.time_s - known) > 0.001:
            other_times.append(
                f"{where}: time is {new.time_s:g} s, but {known:g} s in an earlier line of scene {new.scene_id}, "
                f"image {new.im_id}; all estimates of an image share one time"
            )
            new = replace(new, time_s=known)
        estimates.append(new)
    if not estimates:
        raise ContentError(next(iter(faults.values()), f"no estimates, expected a BOP results CSV ({HEADER})"))
    return ResultLines(tuple(estimates), faults, tuple(other_times))


def write_results(path: Path | str, rows: Iterable[ResultRow]) -> None:
    """Writes a results file; it appears under its name only when it is complete. Numbers are written with all their
    digits.

    Raises:
        InputError: the file cannot be written.
    """
    with atomic(Path(path)) as part, part.open("w", encoding="utf-8", newline="\n") as file:
        file.write(HEADER + "\n")
        file.writelines(map(results_line, rows))


def method_of(path: Path | str) -> str:
    """The method's name in a results file's name: ``cosypose`` in ``cosypose_ycbv-test.csv``."""
    stem = Path(path).stem
    named = re.match(r"(.+?)_[^_]+-(?:test|val|train)[^_]*(?:_.*)?$", stem)
    return named.group(1) if named else stem


def results_line(row: ResultRow) -> str:
    """The line of a results file for an estimate."""
    R = " ".join(repr(float(x)) for x in row.T_cam_obj[:3, :3].ravel())
    t_mm = " ".join(repr(float(x)) for x in row.T_cam_obj[:3, 3] * 1e3)
    return f"{row.scene_id},{row.im_id},{row.obj_id},{float(row.score)!r},{R},{t_mm},{float(row.time_s)!r}\n"


def _row(line: ResultLine) -> ResultRow:
    for name, values in (("score", np.array(line.score)), ("R", line.R), ("t", line.t_mm)):
        if not np.isfinite(values).all():
            raise ContentError(f"line {line.number}: {name} holds NaN or infinity, expected finite numbers")
    T_cam_obj = as_rigid(transform(line.R, line.t_mm * 1e-3), f"line {line.number}: the pose")
    return ResultRow(line.scene_id, line.im_id, line.obj_id, line.score, T_cam_obj, line.time_s)


def _line_of(line: str, number: int, where: str) -> ResultLine:
    fields = line.split(",")
    if len(fields) != 7:
        there = "a blank line" if not line.strip() else f"{len(fields)} comma-separated fields"
        raise ContentError(f"{where}: found {there}, expected 7 fields ({HEADER})")
    names = ("scene_id", "im_id", "obj_id")
    scene_id, im_id, obj_id = (_integer(text, name, where) for text, name in zip(fields[:3], names, strict=True))
    score = float(_numbers(fields[3], 1, "score", where)[0])
    R, t_mm = _numbers(fields[4], 9, "R", where).reshape(3, 3), _numbers(fields[5], 3, "t", where)
    try:
        time_s = float(fields[6])
    except ValueError:
        raise ContentError(
            f"{where}: time is {quoted(fields[6].strip(), 40)}, expected seconds (-1 = unknown)"
        ) from None
    return ResultLine(number, scene_id, im_id, obj_id, score, R, t_mm, time_s)


def _is_header(line: str) -> bool:
    """Whether a line is a header: nothing in it is a number."""
    words = re.split(r"[,;\s]+", line.strip())
    return all(re.fullmatch(r"[^\W\d]\w*", word) for word in words)


def _hint(path: Path) -> str:
    """A hint at the poses of a batch, where its table of objects was given in their place."""
    poses = path.with_name("results.csv")
    return f"; the poses of this run are in {poses}" if path.name == "frames.csv" and poses.is_file() else ""


def _integer(text: str, name: str, where: str) -> int:
    try:
        value = int(text)
    except ValueError:  # no integer, or one of more than 4300 digits
        raise ContentError(f"{where}: {name} is {quoted(text.strip(), 40)}, expected an integer") from None
    if abs(value) >= 2**63:
        raise ContentError(f"{where}: {name} is {quoted(text.strip(), 40)}, expected an integer below 2⁶³")
    return value


def _numbers(text: str, n: int, name: str, where: str) -> Float:
    expected = "one number" if n == 1 else f"{n} numbers separated by blanks"
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        raise ContentError(f"{where}: {name} is {quoted(text.strip(), 40)}, expected {expected}") from None
    if len(values) != n:
        wrong = f"holds {len(values)} numbers" if len(values) else "is empty"
        raise ContentError(f"{where}: {name} {wrong}, expected {expected}")
    return values
