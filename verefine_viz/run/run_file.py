"""The run file (``.vfrun``): a header, every iteration bit by bit, and at last the answers.

It is appended to and never rewritten. An entry is its length and its CRC-32 (4 bytes each, little-endian), a letter for
its kind, and the record as msgpack, field by field as in ``core.records`` and ``run.record``; an array is its type, its
shape and its bytes. Each entry is handed to the operating system before the run goes on: if the writer is killed, no
iteration is lost.
"""

from __future__ import annotations

import math
import os
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import msgspec
import numpy as np
from msgspec import structs

from verefine_viz.core.arrays import finite, frozen
from verefine_viz.core.errors import InputError, one_line, quoted
from verefine_viz.core.files import LONGEST, read_file
from verefine_viz.core.frame_names import frame_name, parse_frame
from verefine_viz.core.geometry import as_rigid
from verefine_viz.core.protocols import RunState
from verefine_viz.core.records import NO_CONTACTS, Iteration, SimulatedPath
from verefine_viz.core.settings import Session
from verefine_viz.core.writing import make_inside, new_file
from verefine_viz.run import first_format
from verefine_viz.run.record import FORMAT, RunEnd, RunHeader, RunRecord
from verefine_viz.run.run_header import NO_WEIGHTS, header_of, session_of
from verefine_viz.run.session_file import parsed_toml

SUFFIX = ".vfrun"
MAGIC = b"VEREFINE RUN\n"
_HEAD = struct.Struct("<II")
_HEADER, _ITERATION, _END = b"H", b"I", b"E"
R = TypeVar("R", RunHeader, Iteration, RunEnd)


class RunFile:
    """Writes a run file. As a watcher it writes a run's header and every iteration."""

    def __init__(self, path: Path, session: Session, weights: Mapping[str, str] = NO_WEIGHTS) -> None:
        """Write nothing before :meth:`begin` or :meth:`on_start`; the folder is made if needed.

        Args:
            path: the file, ``….vfrun``.
            session: what is being run.
            weights: hashes of the run's weights, for the header; ``session_parts.weights_of`` gives those of a session.
        """
        self.path = path
        self._session, self._weights = session, weights
        self._file = -1

    def begin(self, header: RunHeader) -> None:
        """Create the file, replacing any old one.

        Raises:
            InputError: it cannot be written.
        """
        self.close()
        make_inside(self.path.parent)
        self._file = new_file(self.path)
        self._write(_beginning(header))

    def append(self, iteration: Iteration) -> None:
        """Raise InputError where the disk does not take it."""
        self._write(_entry(iteration))

    def finish(self, end: RunEnd) -> None:
        """Write how the run ended, and close the file.

        Raises:
            InputError: the disk does not take it.
        """
        self._write(ending(end))
        self.close()

    def finished_as(self, end: RunEnd) -> bytes:
        """The content of the file as if it were finished with ``end``.

        Raises:
            InputError: what is written of it cannot be read.
        """
        return read_file(self.path, "run file") + ending(end)

    def close(self) -> None:
        """End the file without answers; later calls do nothing."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def on_start(self, state: RunState) -> None:
        self.begin(header_of(state.problem, state, self._session, self._weights))

    def on_iteration(self, state: RunState, iteration: Iteration) -> None:
        self.append(iteration)

    def on_finish(self, state: RunState) -> None:
        """Do nothing: :meth:`finish` writes the answers, which are still to be worked out."""

    def _write(self, content: bytes) -> None:
        try:
            # A nearly full disk takes a part, and refuses the rest.
            while content:
                content = content[os.write(self._file, content) :]
        except OSError as error:
            raise self._refused(error) from None

    def _refused(self, error: OSError) -> InputError:
        return InputError(f"cannot write {self.path}: {error.strerror or error}")


def write_record(path: Path, record: RunRecord) -> None:
    """Write a whole record to a file, replacing any old one.

    Raises:
        InputError: it cannot be written.
    """
    file = RunFile(path, session_of(record.header))
    file.begin(record.header)
    for iteration in record.iterations:
        file.append(iteration)
    if record.end is not None:
        file.finish(record.end)
    file.close()


def encoded(record: RunRecord) -> bytes:
    """The content of the file of a whole record; :func:`decoded` reads it."""
    end = b"" if record.end is None else ending(record.end)
    return b"".join([_beginning(record.header), *map(_entry, record.iterations), end])


def read_run_file(path: Path, with_iterations: bool = True) -> RunRecord:
    """The run in a file: all of it, or the readable beginning (:attr:`RunRecord.missing`).

    Args:
        path: the file.
        with_iterations: whether iterations are returned; they are checked for damage in any case.

    Raises:
        InputError: it cannot be read, is something else or of a later version, or holds not even its header.
    """
    return decoded(read_file(path, "run file"), f"run file {path}", with_iterations)


def decoded(content: bytes, what: str, with_iterations: bool = True) -> RunRecord:
    """The run in the bytes of a run file, as :func:`read_run_file` reads it; ``what`` names them in an error."""
    if not content:
        raise InputError(f"{what} is empty, expected one that view or batch wrote (.vfrun)")
    if not content.startswith(MAGIC):
        raise InputError(f"{what} is no run file, expected one that view or batch wrote (.vfrun)")
    entries = _Bodies(content)
    bodies = iter(entries)
    first = next(bodies, None)
    if first is None or first[:1] != _HEADER:
        raise InputError(f"{what} holds nothing of a run; run its session again")
    iterations: list[Iteration] = []
    end: RunEnd | None = None
    n, part = 0, "its header"
    try:
        header = _header(first[1:], what)
        if with_iterations:
            _check_session(header)
        for body in bodies:
            part = f"iteration {n + 1}"
            if body[:1] == _ITERATION and end is None:
                n += 1
                if with_iterations:
                    iterations.append(_iteration(body[1:]))
                elif _INDEX_DECODER.decode(body[1:]).index != n:
                    raise ValueError(f"iteration {n} is missing")
            elif body[:1] == _END and end is None:
                part = "its answers"
                end = _END_DECODER.decode(body[1:])
                if header.format == 1:
                    end = first_format.with_findings(end, body[1:])
            else:
                raise ValueError("it holds what no run writes there")
        _check(header, iterations)
        if end is not None:
            _check_end(header, end, n)
    except InputError:
        raise
    except msgspec.ValidationError as error:
        text, _, place = str(error).partition(" - at `$")
        why = f"{text[:LONGEST]}{place and f' (at {place[:-1]})'}"
        raise InputError(f"{what} is damaged: {part}: {one_line(why)}; run its session again") from None
    except (msgspec.DecodeError, RecursionError):
        raise InputError(f"{what} is damaged: {part} cannot be read; run its session again") from None
    except ValueError as error:
        raise InputError(f"{what} is damaged: {one_line(str(error))}; run its session again") from None
    missing = ""
    if end is None:  # Remains of an entry behind the answers do not harm them.
        left = "1 iteration is in it" if n == 1 else f"{n or 'no'} iterations are in it"
        why = "bytes in the middle are damaged" if entries.damage == _DAMAGED else "it was stopped or cut off"
        missing = f"the run ended early ({why}); {left}"
    return RunRecord(header, tuple(iterations), end, end is None and entries.damage == _DAMAGED, missing)


def _beginning(header: RunHeader) -> bytes:
    # A record that was read from an older file is written in the present format.
    return MAGIC + framed(_HEADER + _ENCODER.encode(structs.replace(header, format=FORMAT)))


def _entry(iteration: Iteration) -> bytes:
    return framed(_ITERATION + _ENCODER.encode(thin(iteration)))


def ending(end: RunEnd) -> bytes:
    """The entry that a run ends with."""
    return framed(_END + _ENCODER.encode(end))


def read_endings(file: BinaryIO) -> Iterator[RunEnd]:
    """The ends of several runs, one after another, as :func:`ending` wrote them.

    Raises:
        InputError: the file is damaged.
    """
    while head := file.read(_HEAD.size):
        body = file.read(_HEAD.unpack(head)[0]) if len(head) == _HEAD.size else b""
        if not body or zlib.crc32(body) != _HEAD.unpack(head)[1]:
            raise InputError("answers are damaged")
        try:
            yield _END_DECODER.decode(memoryview(body)[1:])
        except (msgspec.DecodeError, ValueError):
            raise InputError("answers of another version") from None


def framed(body: bytes) -> bytes:
    """A body with its length and checksum before it."""
    return _HEAD.pack(len(body), zlib.crc32(body)) + body


def thin(iteration: Iteration) -> Iteration:
    """The iteration as it is written: its simulated path, which is only drawn, in single precision and with only the
    contacts of the last step.
    """
    path = iteration.path
    if path is None:
        return iteration
    Ts_cam_obj: Any = path.Ts_cam_obj.astype(np.float32)
    return structs.replace(iteration, path=SimulatedPath(Ts_cam_obj, path.contacts[-1:], path.tipping))


def as_read(record: R) -> R:
    """The record as it is read back."""
    if isinstance(record, Iteration):
        return _iteration(_ENCODER.encode(thin(record)))
    decoder: Any = _HEADER_DECODER if isinstance(record, RunHeader) else _END_DECODER
    return decoder.decode(_ENCODER.encode(record))


_DAMAGED, _CUT = "damaged", "cut"


class _Bodies:
    """The successive bodies of a run file, up to the first incomplete one; then the reason why they end."""

    def __init__(self, content: bytes) -> None:
        self.damage = ""
        self._content = memoryview(content)

    def __iter__(self) -> Iterator[memoryview]:
        content, at = self._content, len(MAGIC)
        while at < len(content):
            if at + _HEAD.size > len(content):
                self.damage = _CUT
                return
            length, crc = _HEAD.unpack_from(content, at)
            body = content[at + _HEAD.size : at + _HEAD.size + length]
            # No entry is empty: zeros are left by a file system that had no time to write.
            if len(body) < length or not length or zlib.crc32(body) != crc:
                self.damage = _DAMAGED if len(body) == length > 0 else _CUT
                return
            yield body
            at += _HEAD.size + length


def _header(body: memoryview, what: str) -> RunHeader:
    number = msgspec.msgpack.decode(body, type=_Numbered).format
    if number > FORMAT:
        raise InputError(f"{what} was written by a later version (format {number}, this one reads {FORMAT}); update")
    header = _HEADER_DECODER.decode(body)
    if frame_name(parse_frame(header.frame)) != header.frame:
        raise ValueError(f"{quoted(header.frame)} is no frame")
    if len({one.instance_id for one in header.objects}) < len(header.objects):
        raise ValueError("an object is in it twice")
    poses = [("camera pose", header.T_map_cam), ("table", header.T_table_cam)]
    poses += [(f"ground truth of {one.name}", one.T_cam_obj_gt) for one in header.objects]
    for name, T in poses:
        if T is not None:
            as_rigid(T, name)
    for one in header.objects:
        if len(one.initial) not in (0, len(one.hypotheses)):
            raise ValueError(f"{one.name} has {len(one.hypotheses)} hypotheses and {len(one.initial)} scores")
    return header


def _check_session(header: RunHeader) -> None:
    try:
        parsed_toml(header.session)
    except ValueError:
        raise ValueError("its session is no TOML") from None


class _Numbered(msgspec.Struct):
    """The beginning of any version's header."""

    format: int


class _Indexed(msgspec.Struct):
    """The fields that identify an iteration."""

    index: int


def _iteration(body: bytes | memoryview) -> Iteration:
    iteration = _ITERATION_DECODER.decode(body)
    path = iteration.path
    return iteration if path is None else structs.replace(iteration, path=_with_all_steps(path))


def _with_all_steps(path: SimulatedPath) -> SimulatedPath:
    """A path as it was read, with contacts for every step, as a run has them."""
    if path.Ts_cam_obj.ndim != 3 or not len(path.Ts_cam_obj):
        raise ValueError("a simulation has no pose")
    steps = len(path.Ts_cam_obj) - 1
    contacts = (NO_CONTACTS,) * (steps - len(path.contacts)) + path.contacts
    return SimulatedPath(path.Ts_cam_obj.astype(np.float64), contacts, path.tipping)


def _packed_array(value: np.ndarray) -> list[Any]:
    return [value.dtype.str, value.shape, value.tobytes()]


def _array(kind: Any, value: Any) -> np.ndarray:
    # msgspec names the field in what is raised here.
    dtype, shape, content = value if isinstance(value, list) and len(value) == 3 else (None, (), b"")
    if dtype not in _TYPES:
        raise ValueError(f"no array, whose type is one of {', '.join(_TYPES)}")
    is_shape = isinstance(shape, list) and all(isinstance(n, int) and 0 <= n < 2**31 for n in shape)
    kind = np.dtype(dtype)
    if not (is_shape and isinstance(content, bytes) and len(content) == math.prod(shape) * kind.itemsize):
        raise ValueError("an array whose numbers do not fill its shape")
    return np.frombuffer(content, kind).reshape(shape)


_TYPES = ("<f8", "<f4", "<i8")
"""Types of arrays: of poses and scores, of simulated paths, of the ids in contacts."""
_ENCODER = msgspec.msgpack.Encoder(enc_hook=_packed_array)
_HEADER_DECODER = msgspec.msgpack.Decoder(RunHeader, dec_hook=_array)
_ITERATION_DECODER = msgspec.msgpack.Decoder(Iteration, dec_hook=_array)
_INDEX_DECODER = msgspec.msgpack.Decoder(_Indexed)
_END_DECODER = msgspec.msgpack.Decoder(RunEnd, dec_hook=_array)


def _check(header: RunHeader, iterations: Sequence[Iteration]) -> None:
    """Check the iterations of a run against its header.

    Raises:
        ValueError: an iteration cannot be one of a run with these objects and hypotheses.
        ShapeError: it holds arrays that no run makes.
    """
    arms = {one.instance_id: len(one.hypotheses) for one in header.objects}
    obj_ids = {one.instance_id: one.obj_id for one in header.objects}
    n_nodes: dict[int, int] = {}
    """Nodes of each cluster's search tree, so far."""
    for k, i in enumerate(iterations, 1):
        _check_arrays(i)
        n_arms = arms.get(i.instance_id, 0)
        if i.index != k:
            raise ValueError(f"iteration {k} is missing")
        if i.arm not in range(n_arms):
            subject = f"hypothesis {i.arm + 1} of instance {i.instance_id}"
            raise ValueError(f"iteration {i.index} is about {subject}, which has {n_arms}")
        if i.obj_id != obj_ids[i.instance_id]:
            raise ValueError(f"iteration {i.index} is about object {i.obj_id}, and instance {i.instance_id} is another")
        if i.best.arm not in range(n_arms) or i.best.iteration > i.index:
            raise ValueError(
                f"the best pose after iteration {i.index} is of a hypothesis or iteration that is not there"
            )
        if i.stage(i.accepted) is None:
            raise ValueError(f"iteration {i.index} accepted its {i.accepted} pose, and has none")
        choice = () if i.choice is None else (i.choice.plays, i.choice.mean, i.choice.exploration, i.choice.ucb)
        if any(len(numbers) != n_arms for numbers in choice) or (i.choice and i.choice.arm not in range(n_arms)):
            raise ValueError(f"iteration {i.index} chose from another number of hypotheses than {n_arms}")
        unknown = set(_other_instances(i)) - arms.keys()
        if unknown:
            raise ValueError(f"iteration {i.index} places instance {min(unknown)}, which is not in the header")
        if i.path is not None and len(i.path.contacts) != len(i.path.Ts_cam_obj) - 1:
            raise ValueError(f"the simulation of iteration {i.index} has more contacts than steps")
        if i.path is not None and i.path.tipping and i.path.tipping.step > len(i.path.contacts):
            raise ValueError(f"the simulation of iteration {i.index} tips over after its last step")
        if i.tree is not None:
            n, node = n_nodes.get(i.tree.cluster, 1), i.tree.node
            if node is not None:
                if node.node != n or node.parent not in range(n) or node.arm not in range(arms[node.instance_id]):
                    raise ValueError(f"iteration {i.index} adds node {node.node} to a search tree of {n} nodes")
                n += 1
            if not all(number in range(n) for number in i.tree.branch):
                raise ValueError(f"iteration {i.index} visits a node of the search tree that was never added")
            n_nodes[i.tree.cluster] = n


def _check_end(header: RunHeader, end: RunEnd, n: int) -> None:
    """Check the end of a run against its header.

    Raises:
        ValueError: it cannot be the end of that run, of ``n`` iterations.
        ShapeError: it holds arrays that no run makes.
    """
    arms = {one.instance_id: len(one.hypotheses) for one in header.objects}
    seen = set[int]()
    for answer in end.answers:
        if answer.frame != header.frame:
            raise ValueError(f"an answer is about frame {quoted(answer.frame, 40)}, and the run about {header.frame}")
        if answer.instance_id in seen:
            raise ValueError(f"there are two answers for instance {answer.instance_id}")
        seen |= set() if answer.instance_id is None else {answer.instance_id}
        if answer.T_cam_obj is not None:
            as_rigid(answer.T_cam_obj, f"the answer for {answer.name}")
        if answer.middle_m is not None:
            finite(answer.middle_m, f"the middle of {answer.name}", (3,))
        n_arms = arms.get(answer.instance_id) if answer.instance_id is not None else None
        if n_arms is not None and (answer.best_hypothesis or 0) > n_arms:
            raise ValueError(f"the answer for {answer.name} is of hypothesis {answer.best_hypothesis} of {n_arms}")
        places = [answer.best_iteration, answer.worst_iteration, *(finding.iteration for finding in answer.findings)]
        if any(place is not None and place > n for place in places):
            raise ValueError(f"the answer for {answer.name} is of an iteration that is not in the file")
    n_made = sum(answer.n_iterations for answer in end.answers)
    if n_made != n:
        raise ValueError(f"its answers come from {n_made} iterations, and {n or 'none'} are in it")


def _other_instances(iteration: Iteration) -> Iterator[int]:
    """Instances of all poses that the iteration holds besides its stages."""
    scene, tree = iteration.scene, iteration.tree
    poses = [*iteration.placed]
    if scene is not None:
        poses += [*scene.poses, *scene.incumbent]
    if tree is not None:
        poses += [*tree.rollout, *tree.incumbent]
        if tree.node is not None:
            yield tree.node.instance_id
    yield from (pose.instance_id for pose in poses)


def _check_arrays(iteration: Iteration) -> None:
    tree, scene, choice, path = iteration.tree, iteration.scene, iteration.choice, iteration.path
    for stage in iteration.stages:
        as_rigid(stage.T_cam_obj, f"{stage.name} pose")
    as_rigid(iteration.best.T_cam_obj, "best pose")
    placed = [*iteration.placed, *(scene.poses + scene.incumbent if scene is not None else ())]
    if tree is not None:
        placed += [*tree.rollout, *tree.incumbent]
        if tree.node is not None:
            as_rigid(tree.node.T_cam_obj, f"pose of tree node {tree.node.node}")
    for pose in placed:
        as_rigid(pose.T_cam_obj, f"placed pose of instance {pose.instance_id}")
    if choice is not None:
        for name in ("plays", "mean"):
            finite(getattr(choice, name), name, (None,))
        for name in ("exploration", "ucb"):  # Infinite for an arm that was never played.
            if np.isnan(frozen(getattr(choice, name), name, (None,))).any():
                raise ValueError(f"{name} of iteration {iteration.index} holds NaN")
    if path is not None:
        finite(path.Ts_cam_obj, "simulated path", (None, 4, 4))
        for contacts in path.contacts:
            n = len(contacts.depths_m)
            finite(contacts.points_cam, "contact points", (n, 3))
            finite(contacts.normals_cam, "contact normals", (n, 3))
            finite(contacts.forces_n, "contact forces", (n,))
            frozen(contacts.others, "contact partners", (n,), np.int64)
