"""Frames on a Dask cluster: on one that is running somewhere, or on one of our own on this machine.

The scheduler gives the frames of a lost worker to others; this process alone writes the results.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import time
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from socket import create_connection, gaierror
from typing import Any

import dask
from distributed import Client, Future, KilledWorker, LocalCluster, Security, wait
from distributed.comm.addressing import get_address_host_port, parse_address, resolve_address
from distributed.comm.core import connect

import verefine_viz
from verefine_viz.batch.dask_worker import WorkerTools, solve_on_worker
from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.machine import gigabytes
from verefine_viz.batch.runs import file_stem
from verefine_viz.batch.work_queue import WorkQueue
from verefine_viz.batch.worker_pool import interrupts_ignored
from verefine_viz.batch.worker_tasks import ONE_THREAD, TaskName
from verefine_viz.core.errors import SettingsError, UnavailableError, VerefineError
from verefine_viz.core.settings import Session
from verefine_viz.run.record import RunRecord
from verefine_viz.run.session_file import FILES

CONNECT_S = 10.0
"""A scheduler that has not answered by then does not count as there."""
OVER_TCP = ("tcp", "tls", "ws", "wss")
START_LIMIT_S = 20.0
"""After so long without any worker there is a warning."""
COUNT_S = 5.0
"""How often the workers are counted."""
AHEAD = 2
"""Frames per worker that are handed to the scheduler, so that none waits for the next one."""


def _must_answer(address: str) -> None:
    """Returns when a Dask scheduler answers; without this check its client could wait for ever.

    Raises:
        Exception: nothing does in time, or something else does, which may send anything; see :func:`_connection_fault`.
    """
    if parse_address(address)[0] in OVER_TCP:  # Dask would retry until its time is up.
        create_connection(get_address_host_port(address), CONNECT_S).close()
    asyncio.run(_answers(address))


async def _answers(address: str) -> None:
    arguments = Security().get_connection_args("client")
    comm = await asyncio.wait_for(connect(address, timeout=CONNECT_S, **arguments), CONNECT_S)
    comm.abort()


def _connection_fault(error: Exception) -> str:
    """Why nothing at an address answered, in words."""
    message = " ".join(str(error).split())
    match error:
        case ConnectionRefusedError():
            return "nothing listens there"
        case gaierror():
            return "no host of that name is known"
        case TimeoutError():
            return f"no answer for {CONNECT_S:g} s"
        case OSError() | ImportError() | Warning() if message:
            return message
    return "what listens there is no Dask scheduler, or one of another version"


def open_cluster(address: str, session: Session, out: Path, task: TaskName, n_workers: int) -> ClusterWorkers:
    """The workers of the cluster at ``address``, or of a new one here ("local", ``n_workers`` processes).

    Raises:
        SettingsError: it is no address.
        UnavailableError: nothing answers there.
    """
    try:
        with suppress(OSError, ImportError, FutureWarning):  # Reported when it does not answer.
            if address != "local":
                resolve_address(address)
    except ValueError:
        raise SettingsError(
            f"--cluster {address} is no address; expected tcp://HOST:PORT of a Dask scheduler, or local"
        ) from None
    # Trouble is reported in one line of our own; Dask would add pages.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    own = _local(n_workers) if address == "local" else None
    try:
        if own is None:
            _must_answer(address)
        client = Client(own or address, timeout=CONNECT_S)
    except Exception as error:  # Another program that listens there may answer anything.
        if own is not None:
            own.close()
        raise UnavailableError(
            f"no Dask scheduler answers at {address} ({_connection_fault(error)}); start one with: dask scheduler, "
            "which prints its address, tcp://HOST:8786; or say --cluster local"
        ) from None
    return ClusterWorkers(client, own, address, session, out, task)


def _local(n_workers: int) -> LocalCluster:
    with interrupts_ignored():
        return LocalCluster(
            n_workers=n_workers, threads_per_worker=1, processes=True, host="127.0.0.1",
            # Any free port: on the usual one another cluster may be running.
            dashboard_address="127.0.0.1:0", scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL, env=dict.fromkeys(ONE_THREAD, "1"),
        )  # fmt: skip


class ClusterWorkers:
    """The :class:`Workers` of a cluster."""

    def __init__(
        self,
        client: Client,
        own: LocalCluster | None,
        address: str,
        session: Session,
        out: Path,
        task: TaskName,
    ) -> None:
        self._client, self._own, self._address = client, own, address
        self._work = FrameWork(session, out, task)
        self._tools = WorkerTools(
            f"verefine-viz-{secrets.token_hex(4)}", session, out, task,
            (str(out), *_paths(session)), verefine_viz.__version__,
        )  # fmt: skip
        self._opened, self._counted = time.monotonic(), 0.0
        self._n_workers = 0
        self._most_bytes = 0

    @property
    def needs(self) -> str:
        return f"{self._n_workers} × {gigabytes(self._most_bytes)} in workers" if self._most_bytes else ""

    @property
    def warning(self) -> str:
        if self._n_workers or time.monotonic() - self._opened < START_LIMIT_S:
            return ""
        return f"the cluster at {self._address} has no workers; waiting for the first"

    def solve(self, frames: Iterable[str]) -> Iterator[RunRecord | None]:
        """See :class:`verefine_viz.batch.run_batch.Workers`."""
        self._set_up()
        queue = WorkQueue(frames, self._work.line_of)
        running: dict[Future, str] = {}
        while True:
            self._count_workers()
            while len(running) < AHEAD * max(self._n_workers, 1):
                frame = queue.take(running.values())
                if frame is None:
                    break
                running[self._submitted(frame)] = frame
            if not running:
                return
            done = self._done(list(running))
            if not done:
                yield None
            for future in done:
                frame = running.pop(future)
                yield self._result(frame, future)
                future.release()

    def close(self) -> None:
        # The cluster may be gone.
        with suppress(Exception):
            self._client.unregister_worker_plugin(self._tools.name)
        with suppress(Exception):
            self._client.close(timeout=CONNECT_S)
        if self._own is not None:
            with suppress(Exception):
                self._own.close(timeout=CONNECT_S)

    def _set_up(self) -> None:
        try:
            self._client.register_plugin(self._tools)
        except VerefineError as error:
            raise UnavailableError(str(error)) from None
        except Exception as error:
            why = " ".join(f"{type(error).__name__}: {error}".split())
            raise UnavailableError(
                f"the workers of {self._address} cannot be used ({why}); "
                "install the same verefine-viz[cluster], Python and Dask on them"
            ) from None

    def _submitted(self, frame: str) -> Future:
        key = f"{self._tools.name}-{file_stem(frame)}"
        with dask.annotate(executor=self._tools.name):  # pyright: ignore[reportPrivateImportUsage]
            return self._client.submit(solve_on_worker, self._tools.name, frame, key=key, pure=False)

    def _done(self, running: list[Future]) -> list[Future]:
        """The futures that are done; none where nothing was done for a while."""
        try:
            with suppress(TimeoutError):
                wait(running, timeout=COUNT_S, return_when="FIRST_COMPLETED")
        except CancelledError:  # by the client itself, which has lost the connection
            raise self._gone() from None
        self._must_be_there()
        return [future for future in running if future.done()]

    def _must_be_there(self) -> None:
        if self._client.status != "running":
            raise self._gone()

    def _gone(self) -> UnavailableError:
        return UnavailableError(
            f"the scheduler at {self._address} is gone; what is done is saved: start it again and repeat the command"
        )

    def _result(self, frame: str, future: Future) -> RunRecord:
        try:
            record: RunRecord = future.result()
        except KilledWorker as error:
            n = error.allowed_failures + 1
            why = f"{n} workers died on this frame (out of memory, or a library crashed)"
            return self._work.lost(frame, why)
        except Exception as error:
            if future.status != "error":
                raise self._gone() from None  # It is not the frame that failed: its answer cannot be fetched any more.
            return self._work.lost(frame, f"{type(error).__name__}: {error}")
        return record

    def _count_workers(self) -> None:
        """Now and then: workers come and go."""
        if self._n_workers and time.monotonic() - self._counted < COUNT_S:
            return
        self._counted = time.monotonic()
        try:
            workers: dict[str, Any] = self._client.scheduler_info(n_workers=-1)["workers"]
        except Exception:
            self._must_be_there()
            raise
        self._n_workers = len(workers)
        held = [worker.get("metrics", {}).get("memory", 0) for worker in workers.values()]
        self._most_bytes = max([self._most_bytes, *held])


def _paths(session: Session) -> tuple[str, ...]:
    """What the session reads by path."""
    scene, hypotheses = session.scene, session.hypotheses
    named = [scene.dataset] if scene.source != "demo" else []
    named += [scene.masks] if scene.masks not in ("mask", "mask_visib") else []
    named += hypotheses.files if hypotheses.source == "results" else ()
    named += [getattr(getattr(session, section), field) for section, field in FILES]
    return tuple(path for path in named if path)
