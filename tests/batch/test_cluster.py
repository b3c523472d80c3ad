"""Frames on a Dask cluster: the same results as here, also when a worker is lost; clear words when it is not there."""

from __future__ import annotations

import os
import signal
import socketserver
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from socket import socket
from threading import Thread
from types import SimpleNamespace
from typing import Any

import pytest
from distributed import LocalCluster

from tests.batch.conftest import N_FRAMES
from tests.batch.frames import batch_here, started_batch
from tests.batch.killed_batches import n_done, stop_in_the_middle, without_times, workers_of
from verefine_viz import cli
from verefine_viz.batch import cluster
from verefine_viz.batch.dask_worker import WorkerTools
from verefine_viz.batch.run_batch import Backend, BatchStatus
from verefine_viz.batch.run_batch import run_batch as run_here
from verefine_viz.batch.worker_tasks import ONE_THREAD
from verefine_viz.core.errors import UnavailableError
from verefine_viz.core.settings import Session
from verefine_viz.run.session_file import load_session

pytestmark = pytest.mark.usefixtures("processes")


@contextmanager
def cluster_of_others(n_workers: int = 1) -> Iterator[LocalCluster]:
    one_thread = dict.fromkeys(ONE_THREAD, "1")
    with LocalCluster(
        n_workers=n_workers, threads_per_worker=2, host="127.0.0.1", dashboard_address="127.0.0.1:0", env=one_thread
    ) as made:
        yield made


def test_a_worker_that_is_killed_changes_nothing(session: Path, whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with socket() as taken:
        with suppress(OSError):  # Dask's usual port, which another cluster may have.
            taken.bind(("127.0.0.1", 8787))
            taken.listen()
        with started_batch(session, out, "--workers", 1, "--cluster", "local") as child:
            stop_in_the_middle(child, out, N_FRAMES)
            (worker,) = workers_of(child)
            worker.kill()
            os.kill(child.pid, signal.SIGCONT)
            said, errors = child.communicate(timeout=200)
    assert child.returncode == 0, errors
    assert "Traceback" not in errors
    assert "8787" not in errors
    assert f"{N_FRAMES} frames" in said
    assert without_times(out) == without_times(whole)
    assert len(list((out / "recordings").glob("*.rrd"))) == N_FRAMES


def test_a_cluster_gives_the_same_and_keeps_nothing_of_ours_and_may_be_lost(
    session: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "COUNT_S", 0.5)
    out, lost = tmp_path / "out", tmp_path / "lost"
    with cluster_of_others() as running:
        ended = batch_here(session, out, "--cluster", running.scheduler_address)
        assert ended.returncode == 0, ended.stderr
        assert without_times(out) == without_times(whole)
        assert len(list((out / "recordings").glob("*.rrd"))) == N_FRAMES
        # It goes on, with nothing of ours left on it.
        assert running.status.name == "running"
        plugins = [name for worker in running.workers.values() for name in getattr(worker, "plugins", {})]
        assert not [name for name in plugins if name.startswith("verefine")]

        def tell(now: BatchStatus) -> None:
            if now.counts.frames_done == 1:
                running.close()

        with pytest.raises(UnavailableError, match=running.scheduler_address):
            run_here(load_session(session), lost, Backend(cluster=running.scheduler_address), tell)
    n = n_done(lost)
    assert 1 <= n < N_FRAMES
    outcome = run_here(load_session(session), lost, Backend())
    # Workers that lose their scheduler may finish their frames.
    assert n <= outcome.n_resumed <= N_FRAMES
    assert outcome.n_failed == 0
    assert without_times(lost)[0] == without_times(whole)[0]


def test_a_cluster_without_workers_is_waited_for_and_said(
    session: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "COUNT_S", 0.2)
    monkeypatch.setattr(cluster, "START_LIMIT_S", 0.1)
    said: list[str] = []
    with cluster_of_others(n_workers=0) as empty:

        def tell(now: BatchStatus) -> None:
            if now.warning and not said:
                said.append(now.warning)
                empty.scale(1)

        outcome = run_here(load_session(session), tmp_path / "out", Backend(cluster=empty.scheduler_address), tell)
    (warning,) = said
    assert empty.scheduler_address in warning
    assert outcome.totals["frames_done"] == N_FRAMES
    assert without_times(tmp_path / "out")[0] == without_times(whole)[0]


class Greeter(socketserver.BaseRequestHandler):
    """Says something of its own at the first word, as other servers do."""

    def handle(self) -> None:
        self.request.recv(1)
        self.request.sendall(b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n" + bytes(100))


def test_what_is_no_cluster_is_one_line_before_anything_runs(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def refused(*words: object) -> str:
        assert cli.main(["batch", str(session), "--out", str(tmp_path / "out"), *map(str, words)]) == 2
        assert not (tmp_path / "out").exists()
        (line,) = capsys.readouterr().err.splitlines()
        return line

    for address in ("localhost:1", "no.host.invalid:8786"):
        assert address in refused("--cluster", address)
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Greeter) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        port = server.server_address[1]
        assert str(port) in refused("--cluster", f"127.0.0.1:{port}")
        server.shutdown()
    # Only workers of this machine are counted by its cores.
    many = ("--workers", 4 * (os.cpu_count() or 1) + 1)
    assert "--workers" in refused(*many, "--cluster", "local")
    assert "tcp://127.0.0.1:1" in refused(*many, "--cluster", "tcp://127.0.0.1:1")


def test_without_dask_the_extra_is_named(session: Path, tmp_path: Path) -> None:
    code = (
        "import sys\nsys.modules['dask'] = sys.modules['distributed'] = None\n"
        "from verefine_viz import cli\nsys.exit(cli.main(sys.argv[1:]))"
    )
    words = ["batch", str(session), "--out", str(tmp_path / "out"), "--cluster", "local"]
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert "verefine-viz[cluster]" in line


@pytest.mark.parametrize(
    ("version", "must_see", "said"), [("0.0.1", (), r"0\.0\.1"), (None, ("/no/such/folder",), "/no/such/folder")]
)
def test_a_worker_says_why_it_cannot_help(
    version: str | None, must_see: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    import verefine_viz

    worker: Any = SimpleNamespace(address="tcp://10.0.0.7:1234", executors={})
    tools = WorkerTools("name", Session(), tmp_path, "solve", must_see, version or verefine_viz.__version__)
    with pytest.raises(UnavailableError, match=said):
        tools.setup(worker)
    assert worker.executors == {}
