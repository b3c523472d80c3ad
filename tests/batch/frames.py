"""A BOP folder of several small frames, and the real command line run on it."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from tests.scenes.bop_folder import Made, make
from verefine_viz import cli
from verefine_viz.batch import batch_command, worker_pool
from verefine_viz.batch.worker_tasks import Work
from verefine_viz.core.progress_token import NEVER_CANCELLED

ROOT = Path(__file__).resolve().parents[2]
SCENE_ID = 7


def make_frames(root: Path, n_frames: int) -> Made:
    """The made-up frame, ``n_frames`` times: images 0, 1, 2, … of scene 7."""
    made = make(root, scene_id=SCENE_ID, im_id=0, targets=False)
    for name in ("scene_camera.json", "scene_gt.json", "scene_gt_info.json"):
        entry = json.loads((made.scene / name).read_text())["0"]
        (made.scene / name).write_text(json.dumps({str(i): entry for i in range(n_frames)}))
    for kind in ("rgb", "depth", "mask", "mask_visib"):
        for first in sorted((made.scene / kind).iterdir()):
            for i in range(1, n_frames):
                (first.parent / first.name.replace("000000", f"{i:06d}", 1)).write_bytes(first.read_bytes())
    return made


@contextmanager
def damaged(file: Path) -> Iterator[None]:
    """The second half of a file is missing for a while."""
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    try:
        yield
    finally:
        file.write_bytes(whole)


def write_session(folder: Path, made: Made, **sections: dict[str, object]) -> Path:
    """A quick session on ``made``: RIR with 2 hypotheses of 2 iterations."""
    raw: dict[str, dict[str, object]] = {
        "scene": {"source": "bop", "dataset": str(made.root), "model_points": 300, "cloud_points": 300},
        "hypotheses": {"max_per_object": 2, "rotation_deg": 10.0, "translation_mm": 10.0},
        "method": {"name": "rir", "iterations": 2},
        "recording": {"keep": "none"},
    }
    for name, fields in sections.items():
        raw[name] = {**raw.get(name, {}), **fields}
    lines = [
        f"[{name}]\n" + "".join(f"{k} = {json.dumps(v)}\n" for k, v in fields.items()) for name, fields in raw.items()
    ]
    file = folder / "session.toml"
    file.write_text("\n".join(lines))
    return file


def command(*words: object) -> list[str]:
    """``verefine-viz`` with these words, run by this interpreter."""
    return [sys.executable, "-m", "verefine_viz.cli", *map(str, words)]


class PoolHere:
    """Solves items in this process, one after another: a stand-in for one worker, which takes seconds to start."""

    needs = warning = ""

    def __init__(self, work: Work[Any, Any], n_workers: int, *_: object) -> None:
        assert n_workers == 1
        self.switch_to(work)

    def switch_to(self, work: Work[Any, Any]) -> None:
        self._work, self._solve = work, work.begin(NEVER_CANCELLED)

    def solve(self, items: Iterable[Any]) -> Iterator[Any]:
        for item in items:
            yield self._solve(item, lambda: None)

    def close(self) -> None:
        """Has nothing to end."""


def batch_here(sessions: Path | list[Path], out: Path, *words: object) -> subprocess.CompletedProcess[str]:
    """Run ``verefine-viz batch`` in this process, which spares seconds of imports; its frames too if --workers is 1."""
    paths = sessions if isinstance(sessions, list) else [sessions]
    arguments = ["batch", *map(str, paths), "--out", str(out), *map(str, words)]
    with (
        redirect_stdout(io.StringIO()) as said,
        redirect_stderr(io.StringIO()) as errors,
        pytest.MonkeyPatch.context() as patched,
    ):
        if ("--workers", "1") in pairwise(arguments):
            patched.setattr(worker_pool, "Pool", PoolHere)
            patched.setattr(batch_command, "Pool", PoolHere)
        code = cli.main(arguments)
    return subprocess.CompletedProcess(arguments, code, said.getvalue(), errors.getvalue())


@contextmanager
def started_batch(session: Path, out: Path, *words: object) -> Iterator[subprocess.Popen[str]]:
    """Start ``verefine-viz batch`` in a process group of its own: Ctrl-C can be sent to all of it, and none is left."""
    with subprocess.Popen(
        command("batch", session, "--out", out, *words),
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True, cwd=ROOT, start_new_session=True, env=os.environ | {"COLUMNS": "200"},
    ) as child:  # fmt: skip
        try:
            yield child
        finally:
            if child.poll() is None:
                os.killpg(child.pid, signal.SIGKILL)


def depth_file(made: Made, im_id: int) -> Path:
    """The depth image of a frame."""
    return made.scene / "depth" / f"{im_id:06d}.png"
