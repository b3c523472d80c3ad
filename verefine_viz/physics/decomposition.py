"""Convex parts of a mesh by CoACD, in a process of its own: its call takes seconds, and nothing else could stop it."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.patience import ENDLESS, Patience

MAX_PARTS = 16
LOOK_S = 0.1
"""Time between two looks at whether somebody still waits [s]."""


def decomposed(name: str, vertices: Float, faces: NDArray[np.int32], patience: Patience = ENDLESS) -> list[Float]:
    """Vertices (n, 3) of each convex part of a mesh, the same bits at each call.

    Args:
        name: of the mesh, for messages.
        vertices: (V, 3).
        faces: (F, 3).
        patience: asked ten times a second.

    Raises:
        ShapeError: CoACD fails on the mesh.
        Cancelled: nobody waits for them any more.
    """
    paths = (str(Path(__file__).resolve().parents[2]), os.environ.get("PYTHONPATH"))
    # -P: nothing is imported out of the folder that the program was started in. A session of its own: Ctrl-C is for
    # the program, which then ends this process.
    with subprocess.Popen(
        [sys.executable, "-P", "-m", __name__],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))},
    ) as child:  # fmt: skip
        try:
            answer, said = _answer(child, _packed(vertices=vertices, faces=faces), patience)
        except BaseException:
            child.kill()
            raise
    if child.returncode != 0:
        reason = (said.decode(errors="replace").strip().splitlines() or ["it said nothing"])[-1]
        raise ShapeError(
            f"{name} cannot be taken apart into convex parts (CoACD ended with exit code {child.returncode}: "
            f'{reason}); set physics.collider = "hull"'
        )
    with np.load(io.BytesIO(answer), allow_pickle=False) as found:
        return np.split(found["vertices"], found["splits"]) if len(found["vertices"]) else []


def _answer(child: subprocess.Popen[bytes], given: bytes, patience: Patience) -> tuple[bytes, bytes]:
    """What a process that is given its input writes to its output and its error output."""
    left: bytes | None = given
    while True:
        patience.ask()
        try:
            return child.communicate(left, timeout=LOOK_S)
        except subprocess.TimeoutExpired:
            left = None  # It is on its way.


def _packed(**arrays: NDArray) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def _decompose() -> None:
    """The process's main: a mesh from its input, parts to its output."""
    import coacd

    # Whatever the library may print must not get between.
    output = os.dup(1)
    os.dup2(2, 1)
    with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as given:
        mesh = coacd.Mesh(given["vertices"], given["faces"])
    coacd.set_log_level("off")
    found = coacd.run_coacd(
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
    parts = [np.asarray(part_vertices) for part_vertices, _ in found]
    splits = np.cumsum([len(part) for part in parts])[:-1]
    with open(output, "wb") as file:  # noqa: PTH123
        file.write(_packed(vertices=np.vstack(parts) if parts else np.empty((0, 3)), splits=splits))


if __name__ == "__main__":
    _decompose()
