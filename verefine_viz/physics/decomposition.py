"""Convex parts of a mesh by CoACD, in a process of its own: its call takes seconds, and cannot be stopped otherwise."""

from __future__ import annotations

import io
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.array_cache import NPZ_READING
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken

MAX_PARTS = 16
LIMIT_S = 60
"""Most processor time for a mesh, of all threads together [s]. The models of YCB-Video, LINEMOD and the built-in
scenes take up to 10 s; a mesh that takes a minute is a soup of triangles, whose parts mean nothing. Processor time, not
time on the clock: the result must not depend on how busy the machine is."""
PARTS_OF = "the convex parts of"
"""Start of every message while a decomposition is awaited."""
CHECKPOINT_S = 0.1
"""Time between two checkpoints [s]."""


class TookTooLong(Exception):
    """A mesh could not be taken apart within ``LIMIT_S``."""


def decomposed(
    name: str, vertices: Float, faces: NDArray[np.int32], progress: ProgressToken = NEVER_CANCELLED
) -> list[Float]:
    """Vertices (n, 3) of each convex part of a mesh, the same bits at each call.

    Args:
        name: of the mesh, for messages.
        vertices: (V, 3).
        faces: (F, 3).
        progress: asked ten times a second.

    Raises:
        TookTooLong: it takes more than ``LIMIT_S``.
        ShapeError: CoACD fails on the mesh.
        Cancelled: through ``progress``.
    """
    paths = (str(Path(__file__).resolve().parents[2]), os.environ.get("PYTHONPATH"))
    # Threads that spin while they wait would use up processor time.
    settings = {"PYTHONPATH": os.pathsep.join(filter(None, paths)), "OMP_WAIT_POLICY": "passive"}
    # Files, not pipes: neither side waits for the other.
    with TemporaryFile() as mesh, TemporaryFile() as result, TemporaryFile() as errors:
        np.savez(mesh, vertices=vertices, faces=faces)
        mesh.seek(0)
        # -P: nothing is imported out of the folder that the program was started in. A session of its own: Ctrl-C is for
        # the program, which then ends this process.
        with subprocess.Popen(
            [sys.executable, "-P", "-m", __name__, str(LIMIT_S)],
            stdin=mesh, stdout=result, stderr=errors, start_new_session=True, env={**os.environ, **settings},
        ) as child:  # fmt: skip
            try:
                _wait(child, name, progress)
            except BaseException:
                child.kill()
                raise
        if child.returncode == -signal.SIGXCPU:
            raise TookTooLong
        if child.returncode != 0:
            errors.seek(0)
            reason = (errors.read().decode(errors="replace").strip().splitlines() or ["no message"])[-1]
            raise ShapeError(
                f"{name} cannot be taken apart into convex parts (CoACD ended with exit code {child.returncode}: "
                f'{reason}); set physics.collider = "hull"'
            )
        result.seek(0)
        with NPZ_READING, np.load(result, allow_pickle=False) as parts:
            return np.split(parts["vertices"], parts["splits"]) if len(parts["vertices"]) else []


def _wait(child: subprocess.Popen[bytes], name: str, progress: ProgressToken) -> None:
    """Wait until the process ends, reporting every second how long that has taken."""
    doing = f"Preparing {PARTS_OF} {name} for physics"
    progress.announce(f"{doing}, once: seconds for most models; after {LIMIT_S} s of computing its hull is taken.")
    started, reported_s = time.monotonic(), 0
    while True:
        try:
            child.wait(CHECKPOINT_S)
            return
        except subprocess.TimeoutExpired:
            now_s = int(time.monotonic() - started)
            progress.checkpoint(f"{doing}, {now_s} s so far." if now_s > reported_s else "")
            reported_s = now_s


def _decompose(limit_s: int) -> None:
    """The process's main: a mesh from its input, parts to its output; killed by SIGXCPU when its time is up."""
    import coacd

    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # No core dump is left behind then.
    # Output of the library must not mix with the parts.
    output = os.dup(1)
    os.dup2(2, 1)
    with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as given:
        mesh = coacd.Mesh(given["vertices"], given["faces"])
    coacd.set_log_level("off")
    hulls = coacd.run_coacd(
        mesh,
        threshold=0.08,
        max_convex_hull=MAX_PARTS,
        preprocess_resolution=30,
        resolution=300,
        mcts_nodes=5,
        mcts_iterations=10,
        mcts_max_depth=2,
        decimate=True,
        max_ch_vertex=64,
        seed=0,
    )
    parts = [np.asarray(part_vertices) for part_vertices, _ in hulls]
    splits = np.cumsum([len(part) for part in parts])[:-1]
    with open(output, "wb") as file:  # noqa: PTH123
        np.savez(file, vertices=np.vstack(parts) if parts else np.empty((0, 3)), splits=splits)


if __name__ == "__main__":
    _decompose(int(sys.argv[1]))
