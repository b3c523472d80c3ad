"""Draws recordings in a process of its own, so that a run pays for its journal and for nothing else.

The run's process appends iterations to the journal, as ever. The writer's process is told when a recording begins, what
the frame looks like, and now and then that there is more in the journal; it draws what it finds there into the
``.part`` and gives the file its name at the end. If it dies, whoever waits for it draws the recording from the journal.
"""

from __future__ import annotations

import copy
import io
import os
import pickle
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from queue import SimpleQueue
from typing import Any, BinaryIO

from verefine_viz.core.errors import InputError
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.problem import Problem
from verefine_viz.recording.drawn import Drawn, Job, draw_whole

DONE, REFUSED, FAILED = "done", "refused", "failed"
"""What the process answers at the end of a recording; the second with the reason: a line for people."""
_LENGTH = struct.Struct("<Q")


class WriterProcess:
    """One for all recordings of this process, one after the other; begun when it is first needed.

    Whoever makes it closes it (it is a context manager). A recording is complete after :meth:`wait`, which the next
    recording calls as well.
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._outgoing: SimpleQueue[Sequence[Any] | None] = SimpleQueue()
        self._sender: threading.Thread | None = None
        self._models: dict[int, tuple[int, ObjectModel]] = {}
        self._job: Job | None = None
        self._is_ending = False

    def __enter__(self) -> WriterProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def pid(self) -> int | None:
        """Of the process; None where it was not needed yet."""
        return self._process.pid if self._process else None

    def begin(self, job: Job) -> None:
        """A new recording, whose journal is there.

        Raises:
            InputError: the recording before could not be written.
        """
        self.wait()
        assert self._job is None, "one recording after the other"
        if self._process is None:
            self._start()
        for model in job.problem.models.values():
            if id(model) not in self._models:
                # Kept, so that no other model can ever have its id.
                self._models[id(model)] = (len(self._models), model)
                self._send(("model", model), {}, set())
        numbers = {key: number for key, (number, _) in self._models.items()}
        observation, instances = job.problem.observation, job.problem.instances
        unseen = {id(observation.normals_cam), *(id(i.mask) for i in instances)}
        self._send(("begin", Job(job.path, job.about, job.layout, _bare(job.problem))), numbers, unseen)
        self._job, self._is_ending = job, False

    def more(self) -> None:
        """There are iterations in the journal that are worth drawing."""
        self._send(("more",), {}, set())

    def end(self) -> None:
        """The journal is complete; returns at once."""
        self._send(("end",), {}, set())
        self._is_ending = True

    def wait(self) -> None:
        """Until the recording that was ended is complete, wherever it is drawn in the end.

        Raises:
            InputError: it could not be written.
        """
        job, process = self._job, self._process
        if job is None or process is None or not self._is_ending:
            return
        self._job = None
        assert process.stdout is not None
        answer, _, reason = process.stdout.readline().decode().strip().partition(" ")
        if answer == REFUSED:
            raise InputError(reason)
        if answer != DONE:
            if answer != FAILED:
                self._stop()
            draw_whole(job)

    def close(self) -> None:
        """Waits, and ends the process. Later calls do nothing.

        Raises:
            InputError: the last recording could not be written.
        """
        try:
            self.wait()
        finally:
            self._stop()

    def _start(self) -> None:
        command = [sys.executable, "-m", "verefine_viz.recording.writer"]
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert process.stdin is not None
        self._outgoing = SimpleQueue()
        # The process may still be starting, or drawing: the run must not wait until it listens.
        self._sender = threading.Thread(target=_pump, args=(self._outgoing, process.stdin), daemon=True)
        self._sender.start()
        self._process, self._models = process, {}

    def _stop(self) -> None:
        process, sender = self._process, self._sender
        self._process = self._sender = self._job = None
        if process is None or sender is None:
            return
        self._outgoing.put(None)
        sender.join()
        assert process.stdout is not None
        process.stdout.close()
        process.wait()

    def _send(self, message: tuple[Any, ...], models: Mapping[int, int], unseen: set[int]) -> None:
        buffers: list[pickle.PickleBuffer] = []
        packed = io.BytesIO()
        _Packer(packed, models, unseen, buffers).dump(message)
        self._outgoing.put([packed.getbuffer(), *(b.raw() for b in buffers)])


def _bare(problem: Problem) -> Problem:
    """The same without what was worked out from it."""
    bare = copy.copy(problem)
    bare.__dict__.pop("targets", None)
    return bare


class _Packer(pickle.Pickler):
    """Packs a message for the other end; models that it has are only named, what it never looks at is left out."""

    def __init__(
        self, file: io.BytesIO, models: Mapping[int, int], unseen: set[int], buffers: list[pickle.PickleBuffer]
    ) -> None:
        super().__init__(file, protocol=5, buffer_callback=buffers.append)
        self._models, self._unseen = models, unseen

    def persistent_id(self, obj: Any) -> int | None:
        if id(obj) in self._unseen:
            return -1
        return self._models.get(id(obj)) if isinstance(obj, ObjectModel) else None


class _Unpacker(pickle.Unpickler):
    def __init__(self, parts: Sequence[bytearray], models: Sequence[ObjectModel]) -> None:
        super().__init__(io.BytesIO(parts[0]), buffers=parts[1:])
        self._models = models

    def persistent_load(self, pid: int) -> ObjectModel | None:
        return None if pid < 0 else self._models[pid]


def _pump(outgoing: SimpleQueue[Sequence[Any] | None], pipe: BinaryIO) -> None:
    """Sends what is in the queue until None comes or nobody listens any more; whoever waits then learns of it."""
    try:
        while (parts := outgoing.get()) is not None:
            pipe.write(b"".join(_LENGTH.pack(n) for n in (len(parts), *(len(p) for p in parts))))
            for part in parts:
                pipe.write(part)
            pipe.flush()
        pipe.close()
    except OSError:
        # What is still buffered has nowhere to go.
        try:
            pipe.close()
        except OSError:
            return


def _received(pipe: BinaryIO) -> list[bytearray] | None:
    """The parts of the next message; None when there is none any more."""
    first = pipe.read(_LENGTH.size)
    if len(first) < _LENGTH.size:
        return None
    (n,) = _LENGTH.unpack(first)
    lengths = [_LENGTH.unpack(pipe.read(_LENGTH.size))[0] for _ in range(n)]
    parts = [bytearray(length) for length in lengths]
    for part in parts:
        if pipe.readinto(part) < len(part):  # pyright: ignore[reportAttributeAccessIssue]
            return None
    return parts


def _end_with_parent(parent: int) -> None:
    """A run that was killed may be begun anew: nobody else must then write to the same files."""
    while os.getppid() == parent:
        time.sleep(0.1)
    os._exit(1)


def main() -> None:
    """The process: draws until nothing comes any more."""
    # Ctrl-C reaches all processes of a terminal; the run decides what becomes of the recording.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()
    incoming, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # What others print must not look like an answer.
    models: list[ObjectModel] = []
    drawn: Drawn | None = None
    answer = DONE
    while (parts := _received(incoming)) is not None:
        what, *rest = _Unpacker(parts, models).load()
        try:
            if what == "model":
                models += rest
            elif what == "begin":
                answer, drawn = DONE, None
                drawn = Drawn(rest[0])
            elif drawn is not None and answer == DONE:
                drawn.more() if what == "more" else drawn.end()
        except InputError as error:
            answer = f"{REFUSED} {error}"
        except Exception:
            answer = FAILED
        if what == "end":
            print(answer, file=answers, flush=True)


if __name__ == "__main__":
    main()
