"""Reads the traces that ``verefine_viz/trace.py`` writes, whole ones and those of a program that was killed."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import DTypeLike, NDArray

from verefine_viz.core.array_cache import NPZ_READING
from verefine_viz.core.arrays import Float, frozen, plain_array
from verefine_viz.core.errors import ContentError, InputError, ShapeError, one_line
from verefine_viz.core.files import Numbers3, Numbers3x3, Numbers4x4, decoded_json, first_line, reading
from verefine_viz.core.geometry import as_rigid, check_reach, rounding_note
from verefine_viz.core.label_images import labels_fault, labels_in
from verefine_viz.core.number_kinds import Real
from verefine_viz.core.problem import ANSWER, Hypothesis, RecordedStep
from verefine_viz.core.text_format import unusable
from verefine_viz.scenes.image_files import DEEPEST_M
from verefine_viz.scenes.recorded_frame import RecordedFrame, RecordedObject, frame_ids, natural_key
from verefine_viz.trace import CALLS, FARTHEST_M, FORMAT

MOST_BYTES, MOST_OBJECTS, MOST_HYPOTHESES, MOST_STEPS = 200_000_000, 100, 1000, 20_000
"""Limits of the calls of a trace; hypotheses and steps are those of one object."""
Number = Annotated[int, Meta(ge=-(2**31), le=2**31)]
QUIET_S = 5.0
"""A trace that was not closed counts as over when nothing was written for this long [s]."""
NOT_CLOSED = "the trace was cut short: its program still runs, or was stopped"
"""A note."""


class Call(msgspec.Struct, frozen=True):
    """A line of a trace: about the frame (the first one), an object, a pose, a problem, or the end."""

    trace: int | None = None
    started: Real = 0.0
    K: Numbers3x3 | None = None
    rgb: bool = False
    gravity_cam: Numbers3 | None = None

    object: Number | None = None
    name: Annotated[str, Meta(max_length=200)] = ""
    """Name of the object, or of the step."""
    mesh: Annotated[str, Meta(max_length=300)] | None = None
    """Besides its mesh, an object has a unit, a mask and a ground truth."""
    unit_m: Annotated[float, Meta(gt=0, le=1000)] = 1.0
    mask: Annotated[str, Meta(max_length=300)] = ""
    truth: Numbers4x4 | None = None
    axis: Numbers3 | None = None
    """Axis of symmetry."""

    T: Numbers4x4 | None = None
    hypothesis: Number | None = None
    step: Number | None = None
    answer: bool = False
    score: Real | None = None
    ms: Annotated[float, Meta(ge=0, le=1e12)] = 0.0
    note: str = ""

    problem: str | None = None
    closed: bool = False


def is_trace(folder: Path) -> bool:
    """Whether a folder holds a trace."""
    return (folder / CALLS).is_file()


def traces_in(folder: Path) -> tuple[Path, ...]:
    """The traces of a folder: itself, or those directly in it that are complete, by name with numbers as numbers."""
    if is_trace(folder):
        return (folder,)
    return tuple(path for path in _inside(folder) if not _lacks(path))


def left_out_of(folder: Path) -> tuple[str, ...]:
    """The traces in a folder that are damaged, being written, or lack files, each with the reason."""
    lacks = {path: _lacks(path) for path in (() if is_trace(folder) else _inside(folder))}
    return tuple(one_line(f"{path.name} ({why})") for path, why in lacks.items() if why)


def _inside(folder: Path) -> list[Path]:
    return sorted(filter(is_trace, folder.iterdir()), key=lambda path: natural_key(path.name))


def written_ns(folder: Path) -> dict[int, int]:
    """When each trace of a folder was last written to [ns since 1970], by its image number."""
    traces = traces_in(folder)
    ids = frame_ids([path.resolve().name for path in traces])
    # The change time: a copy can keep the other times of a file, but not this one.
    return {number: (path / CALLS).stat().st_ctime_ns for (_, number), path in zip(ids, traces, strict=True)}


def _lacks(folder: Path) -> str:
    """Why a trace cannot be opened: damaged, not closed and just written to, or without a file that it names."""
    try:
        status = (folder / CALLS).stat()
        is_closed, named = _summary(folder, status.st_mtime_ns, status.st_size)
    except (InputError, OSError):
        is_written = _is_fresh(folder / CALLS)
        return "still being written" if is_written else "damaged"
    if not is_closed and (status.st_size == 0 or _is_fresh(folder / CALLS)):
        return "still being written"
    missing = next((name for name in named if not os.path.isfile(folder / name)), "")  # noqa: PTH113
    return f"{missing} is missing" if missing else ""


def _is_fresh(path: Path) -> bool:
    """Whether a file is empty, or was written to a moment ago."""
    try:
        status = path.stat()
    except OSError:
        return False
    return status.st_size == 0 or time.time() - status.st_mtime <= QUIET_S


@lru_cache(maxsize=10_000)
def _summary(folder: Path, changed_ns: int, size: int) -> tuple[bool, tuple[str, ...]]:
    """Whether a trace was closed, and the files that it names, at a time."""
    calls, _ = _calls(folder)
    named = ["depth.npy", *(["rgb.npy"] if calls[0].rgb else [])]
    named += [name for call in calls if call.mesh is not None for name in (call.mesh, call.mask) if name]
    return any(call.closed for call in calls), tuple(named)


def object_names(folder: Path) -> tuple[str, ...]:
    """The names of a trace's objects, in order.

    Raises:
        InputError: the trace cannot be read.
    """
    return tuple(one_line(call.name) for call in _calls(folder)[0] if call.mesh is not None)


def begun_at(folder: Path) -> float:
    """When a trace was begun [s since 1970]."""
    return _calls(folder)[0][0].started


def recorded_answers(folder: Path) -> dict[str, tuple[Float, float | None]]:
    """The last pose (4, 4) [m] of each object of a trace, by name, with the program's score of it where it gave one.

    Raises:
        InputError: the trace cannot be read.
    """
    calls, _ = _calls(folder)
    answers: dict[str, tuple[Float, float | None]] = {}
    for name, own in _poses_by_name(calls).items():
        T = next(filter(_is_rigid, (pose for _, pose in reversed(own))), None)
        if T is None:
            continue
        scored = (o.score for o, pose in reversed(own) if o.score is not None and np.allclose(pose, T, atol=1e-5))
        answers[name] = T, next(scored, None)
    return answers


def _is_rigid(T: Float) -> bool:
    try:
        as_rigid(T, "pose")
    except ShapeError:
        return False
    return True


def _poses_by_name(calls: Sequence[Call]) -> dict[str, list[tuple[Call, Float]]]:
    """The calls about poses, with the poses (4, 4) [m], of each object that has any."""
    poses: dict[int | None, list[tuple[Call, Float]]] = {}
    for call in calls:
        if call.T is not None:
            poses.setdefault(call.object, []).append((call, call.T))
    return {one_line(one.name): poses[one.object] for one in calls if one.mesh is not None and one.object in poses}


def read_trace(folder: Path) -> RecordedFrame:
    """The frame of a trace and all that was recorded in it; unusable records become notes.

    Raises:
        InputError: there is no trace, it is of another version, or its images are damaged or missing.
    """
    calls, notes = _calls(folder)
    head, name = calls[0], one_line(folder.resolve().name)
    if head.K is None:
        raise InputError(f"trace {folder} has no camera; record it again")
    depth = _depth_of(folder / "depth.npy")
    rgb = None
    try:
        rgb = _loaded(folder / "rgb.npy", np.uint8) if head.rgb else None
    except InputError as error:
        notes.append(f"{error}; the frame is drawn without colour")
    if not ((depth >= 0) & (depth <= DEEPEST_M)).all():
        raise InputError(f"{folder / 'depth.npy'}: depth that is negative, or beyond {DEEPEST_M:g} m")
    if depth.ndim != 2 or (rgb is not None and rgb.shape != (*depth.shape, 3)):
        raise InputError(f"trace {folder}: its images do not have one size; record it again")
    problems = [call.problem for call in calls if call.problem is not None]
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        notes.append(f"{len(problems)} not recorded: {one_line(problems[0])}{more}")
    if not any(call.closed for call in calls):
        notes.append(NOT_CLOSED)
    begun = [call for call in calls if call.mesh is not None]
    if len(begun) > MOST_OBJECTS:
        raise InputError(f"trace {folder} has {len(begun)} objects, expected at most {MOST_OBJECTS}")
    strange = {call.object for call in calls if call.T is not None} - {call.object for call in begun}
    if strange:
        n = sum(call.T is not None and call.object in strange for call in calls)
        numbers = ", ".join(map(str, sorted(strange, key=str)[:5]))
        notes.append(f"{n} poses left out, of objects that were never declared (number {numbers})")
    own = _poses_by_name(calls)
    given = [T for call in calls for T in (call.T, call.truth) if T is not None]
    notes += rounding_note("poses of the trace", (T[:3, :3] for T in given))
    objects = [_object(folder, call, own.get(one_line(call.name), ()), depth.shape, notes) for call in begun]
    return RecordedFrame(name, head.K, depth, rgb, tuple(objects), head.gravity_cam, tuple(notes))


def _object(
    folder: Path, begun: Call, own: Sequence[tuple[Call, Float]], shape: tuple[int, ...], notes: list[str]
) -> RecordedObject:
    """An object, given the call that began it and those about its poses."""
    name, mask = one_line(begun.name), None
    if begun.mask:
        try:
            mask = frozen(_mask_in(folder / begun.mask), "the mask", shape, np.bool_)
        except (InputError, ShapeError) as error:
            notes.append(f"{name}: its mask is left out: {error}")
    poses: dict[int, list[tuple[Call, Float]]] = {}
    """Poses of each hypothesis, as the program numbered them."""
    index: dict[int, int] = {}
    steps: list[RecordedStep] = []
    faults: list[str] = []
    for call, pose in own:
        try:
            T = as_rigid(pose, "pose")
            check_reach(T[:3, 3], "pose")
        except ShapeError as error:
            faults.append(str(error))
            continue
        given = (number for number in (call.hypothesis, call.step) if number is not None)
        h = next(given, None)
        h = _nearest(poses, T) if h is None else h
        is_first = h not in poses
        poses.setdefault(h, []).append((call, T))
        index.setdefault(h, len(index))
        if is_first and call.step is not None:
            notes.append(f"{name}: hypothesis {h} has no initial pose; its first step counts as one")
        elif not is_first or call.hypothesis is None:
            what = ANSWER if call.answer else "new initial pose" if call.hypothesis is not None else call.name
            text = one_line(what) or "refined"
            steps.append(RecordedStep(index[h], T, text, call.score, call.ms, one_line(call.note)))
    notes += unusable("pose", name, faults)
    if len(poses) > MOST_HYPOTHESES or len(steps) > MOST_STEPS:
        raise InputError(
            f"trace {folder}: {name} has {len(poses)} hypotheses and {len(steps)} steps, expected at most "
            f"{MOST_HYPOTHESES} and {MOST_STEPS}"
        )
    firsts = [first for (first, *_) in poses.values()]
    scores = tuple(call.score for call, _ in firsts)
    hypotheses = tuple(
        Hypothesis(T, 0.0 if call.score is None else call.score, one_line(call.name) or f"{name} #{h}")
        for h, (call, T) in zip(poses, firsts, strict=True)
    )
    T_gt = None
    if begun.truth is not None:
        try:
            T_gt = as_rigid(begun.truth, "ground truth")
        except ShapeError as error:
            notes.append(f"{name}: {error}; it is left out")
    axis = begun.axis if begun.axis is not None and begun.axis.any() else None
    mesh = folder / begun.mesh if begun.mesh else None
    return RecordedObject(name, mesh, begun.unit_m, mask, hypotheses, scores, tuple(steps), T_gt, axis)


def _nearest(poses: Mapping[int, Sequence[tuple[Call, Float]]], T_cam_obj: Float) -> int:
    """The hypothesis whose latest pose an answer is nearest to; 0 where there is none."""
    return min(poses, key=lambda h: float(np.abs(poses[h][-1][1] - T_cam_obj).max()), default=0)


def _calls(folder: Path) -> tuple[list[Call], list[str]]:
    """The lines of a trace, the one about the frame first; and a note about incomplete lines."""
    if not is_trace(folder):
        raise InputError(f"{folder} holds no trace; expected the folder that verefine_viz.trace.Trace was given")
    calls: list[Call] = []
    faults: list[str] = []
    with reading(folder / CALLS, "trace", MOST_BYTES) as file:
        for number, line in enumerate(file, 1):
            try:
                calls.append(decoded_json(line, Call))
            except (ValueError, RecursionError) as error:  # A program that was killed leaves half a line.
                faults.append(f"line {number}: {first_line(error)}")
                if number == 1:
                    raise
        if not calls or calls[0].trace is None:
            raise ContentError("it has not begun: its program was stopped before the images were written")
        if calls[0].trace != FORMAT:
            raise ContentError("it was written by another version; record it again")
    n = len(faults)
    return calls, [f"{n} line{'s' * (n > 1)} of the trace damaged and left out ({faults[0]})"] if faults else []


def _depth_of(path: Path) -> NDArray[np.float32]:
    """The depth image [m]."""
    with reading(path, most_bytes=MOST_BYTES) as file, NPZ_READING:
        array = np.load(file, allow_pickle=False)
        if isinstance(array, np.ndarray) and array.dtype.kind in "iu":
            raise ContentError(f"it holds {array.dtype}, expected metres as float32; divide millimetres by 1000")
        depth = plain_array(array, np.float32)
        depth = np.where(np.isfinite(depth), depth, np.float32(0))  # Not measured.
        median = float(np.median(depth[depth > 0])) if (depth > 0).any() else 0.0
        if median > FARTHEST_M:
            raise ContentError(f"a median depth of {median:.4g}, expected metres; divide millimetres by 1000")
        return depth


def _loaded(path: Path, dtype: DTypeLike) -> NDArray[Any]:
    with reading(path, most_bytes=MOST_BYTES) as file, NPZ_READING:
        return plain_array(np.load(file, allow_pickle=False), dtype)


def _mask_in(path: Path) -> NDArray[Any]:
    """The pixels of one object: in an image of whole numbers, all that are not 0."""
    with reading(path, most_bytes=MOST_BYTES) as file, NPZ_READING:
        values = np.load(file, allow_pickle=False)
        if not isinstance(values, np.ndarray) or values.dtype.kind not in "iu":
            return plain_array(values, np.bool_)
        if values.ndim == 2 and (fault := labels_fault(values)):
            raise ContentError(f"it {fault}: mask == {labels_in(values)[0]}")
        return values != 0
