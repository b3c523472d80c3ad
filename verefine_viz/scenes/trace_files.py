"""Reads the traces that ``verefine_viz/trace.py`` writes, whole ones and those of a program that was killed."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.errors import InputError, ShapeError
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.paths import open_input, read_input
from verefine_viz.core.problem import ANSWER, Hypothesis, RecordedStep
from verefine_viz.trace import CALLS, FORMAT

QUIET_S = 5.0
"""A trace that was not closed counts as over when nothing was written for so long [s]."""


@dataclass(frozen=True, eq=False)
class RecordedObject:
    """An object of a frame, and what another program did to its poses."""

    name: str
    mesh: Path | None
    """None where the program gave none that could be read."""
    unit_m: float
    """Metres per unit of the mesh file."""
    mask: Mask | None
    """(H, W); None = the pixels that its first pose covers."""
    hypotheses: tuple[Hypothesis, ...]
    scores: tuple[float | None, ...]
    """The program's own, of the hypotheses."""
    steps: tuple[RecordedStep, ...]
    T_cam_obj_gt: Float | None = None


@dataclass(frozen=True, eq=False)
class RecordedFrame:
    """A frame as another program had it."""

    name: str
    K: Float
    depth_m: NDArray[np.float32]
    """(H, W) [m], 0 where nothing was measured."""
    rgb: NDArray[np.uint8] | None
    objects: tuple[RecordedObject, ...]
    down_cam: Float | None = None
    """(3,) where things fall, of any length."""
    notes: tuple[str, ...] = ()


def is_trace(folder: Path) -> bool:
    """Whether a folder holds a trace."""
    return (folder / CALLS).is_file()


def traces_in(folder: Path) -> tuple[Path, ...]:
    """The traces of a folder: itself, or those directly in it that are not being written, by name with numbers as
    numbers.
    """
    if is_trace(folder):
        return (folder,)
    inside = [path for path in folder.iterdir() if is_trace(path) and _is_over(path / CALLS)]
    return tuple(sorted(inside, key=_natural))


def _is_over(calls: Path) -> bool:
    """Whether a trace was closed, or its program has not written for a while."""
    status = calls.stat()
    if not status.st_size or time.time() - status.st_mtime > QUIET_S:
        return status.st_size > 0
    with open_input(calls) as file:
        file.seek(max(status.st_size - 64, 0))
        return b'"closed"' in file.read()


def image_numbers(names: Sequence[str]) -> tuple[int, ...]:
    """A number for each of some files or folders: that at the end of its name, where each has another; else 1, 2, …"""
    ends = [re.search(r"(\d{1,6})$", name) for name in names]
    numbers = [int(end.group(1)) for end in ends if end is not None]
    is_clear = len({*numbers}) == len(names) and not any(re.search(r"\d{7}$", name) for name in names)
    return tuple(numbers) if is_clear else tuple(range(1, len(names) + 1))


def object_names(folder: Path) -> tuple[str, ...]:
    """The names of a trace's objects, in order.

    Raises:
        InputError: the trace cannot be read.
    """
    return tuple(str(line.get("name", "")) for line in _lines(folder)[0] if "object" in line and "name" in line)


def recorded_answers(folder: Path) -> dict[str, tuple[Float, float | None]]:
    """The last pose (4, 4) [m] of each object of a trace, by name, with the program's score of it where it gave one.

    Raises:
        InputError: the trace cannot be read.
    """
    lines, _ = _lines(folder)
    answers: dict[str, tuple[Float, float | None]] = {}
    for line in lines:
        if "object" not in line or "name" not in line:
            continue
        own = [other for other in lines if other.get("object") == line["object"] and len(other.get("T", ())) == 16]
        if own:
            T = np.reshape(own[-1]["T"], (4, 4)).astype(np.float64)
            scored = (o["score"] for o in reversed(own) if "score" in o and np.allclose(o["T"], T.ravel(), atol=1e-5))
            answers[str(line["name"])] = T, next(scored, None)
    return answers


def read_trace(folder: Path) -> RecordedFrame:
    """The frame of a trace and all that was recorded in it; what cannot be used becomes a note.

    Raises:
        InputError: there is no trace, it is of another version, or its images are damaged or missing.
    """
    lines, notes = _lines(folder)
    head = lines[0]
    depth = _loaded(folder / "depth.npy", "depth", np.float32)
    rgb = _loaded(folder / "rgb.npy", "colour", np.uint8) if head.get("rgb") else None
    if depth.ndim != 2 or (rgb is not None and rgb.shape != (*depth.shape, 3)):
        raise InputError(f"trace {folder}: its images do not have one size; record it again")
    problems = [str(line["problem"]) for line in lines if "problem" in line]
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        notes.append(f"{len(problems)} not recorded: {problems[0]}{more}")
    if not any("closed" in line for line in lines):
        notes.append("the trace was not closed: its program still runs, or was stopped")
    objects = []
    for line in lines:
        if "object" in line and "mesh" in line:
            own = [other for other in lines if other.get("object") == line["object"] and "T" in other]
            objects.append(_object(folder, line, own, depth.shape, notes))
    down = head.get("gravity_cam")
    K, gravity = np.array(head["K"], dtype=np.float64), None if down is None else np.array(down, dtype=np.float64)
    return RecordedFrame(folder.resolve().name, K, depth, rgb, tuple(objects), gravity, tuple(notes))


def _object(
    folder: Path, line: Mapping[str, Any], own: Sequence[Mapping[str, Any]], shape: tuple[int, ...], notes: list[str]
) -> RecordedObject:
    """An object's line, and the lines about its poses."""
    name, mesh = str(line["name"]), str(line["mesh"])
    mask = None
    if line.get("mask"):
        mask = _loaded(folder / str(line["mask"]), f"mask of {name}", np.bool_)
        if mask.shape != shape:
            raise InputError(f"trace {folder}: the mask of {name} has another size than depth; record it again")
    poses: dict[int, list[Mapping[str, Any]]] = {}
    """The lines of each hypothesis, as the program numbered them."""
    steps: list[RecordedStep] = []
    for entry in own:
        try:
            T = as_rigid(np.reshape(entry["T"], (4, 4)), "pose")
        except (ShapeError, ValueError) as error:
            notes.append(f"{name}: a recorded pose is left out: {error}")
            continue
        entry = {**entry, "T": T}
        h = int(entry.get("hypothesis", entry.get("step", _nearest(poses, T))))
        is_first = h not in poses
        poses.setdefault(h, []).append(entry)
        if is_first and "step" in entry:
            notes.append(f"{name}: hypothesis {h} has no initial pose; its first step counts as one")
        elif not is_first or "hypothesis" not in entry:
            what = ANSWER if "answer" in entry else "new initial pose" if "hypothesis" in entry else entry.get("name")
            index = [*poses].index(h)
            step = RecordedStep(
                index,
                T,
                str(what or "refined"),
                entry.get("score"),
                float(entry.get("ms", 0.0)),
                str(entry.get("note", "")),
            )
            steps.append(step)
    firsts = [lines[0] for lines in poses.values()]
    scores = tuple(first.get("score") for first in firsts)
    hypotheses = tuple(
        Hypothesis(first["T"], 0.0 if score is None else score, f"{name} #{h}")
        for h, first, score in zip(poses, firsts, scores, strict=True)
    )
    T_gt = None if line.get("truth") is None else as_rigid(np.reshape(line["truth"], (4, 4)), f"ground truth of {name}")
    path = folder / mesh if mesh else None
    return RecordedObject(name, path, float(line["unit_m"]), mask, hypotheses, scores, tuple(steps), T_gt)


def _nearest(poses: Mapping[int, Sequence[Mapping[str, Any]]], T_cam_obj: Float) -> int:
    """The hypothesis whose latest pose an answer is nearest to; 0 where there is none."""
    return min(poses, key=lambda h: float(np.abs(poses[h][-1]["T"] - T_cam_obj).max()), default=0)


def _lines(folder: Path) -> tuple[list[dict[str, Any]], list[str]]:
    """What the calls wrote, the line about the frame first; and notes about lines that are not whole."""
    path = folder / CALLS
    if not is_trace(folder):
        raise InputError(f"{folder} holds no trace; expected the folder that verefine_viz.trace.Trace was given")
    lines: list[dict[str, Any]] = []
    n_damaged = 0
    for raw in read_input(path, "trace").splitlines():
        try:
            line = json.loads(raw)
            lines += [line] if isinstance(line, dict) else []
            n_damaged += not isinstance(line, dict)
        except ValueError:  # A program that was killed leaves half a line.
            n_damaged += 1
    if not lines or "trace" not in lines[0] or "K" not in lines[0]:
        raise InputError(f"trace {folder} has not begun: its program was stopped before the images were written")
    if lines[0]["trace"] != FORMAT:
        raise InputError(f"trace {folder} was written by another version; record it again")
    return lines, [f"{n_damaged} lines of the trace are damaged and left out"] if n_damaged else []


def _loaded(path: Path, what: str, dtype: type[np.generic]) -> NDArray[Any]:
    try:
        with open_input(path) as file:
            return np.load(file, allow_pickle=False).astype(dtype, copy=False)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{path}: the {what} image cannot be read ({error}); record the trace again") from None


def _natural(path: Path) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]
