"""A recorded run for a test to kill: prints each iteration once its recorder has returned."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.fakes import FakeVerifier, box_problem
from tests.recording.runs import new_run, session
from verefine_viz.recording.recorder import Recorder
from verefine_viz.recording.writer import WriterProcess


def main(path: Path, how: str) -> None:
    """``how``: maps, bare, or writer, which prints the process that draws before anything else."""
    s, problem = session(iterations=1000, maps=how == "maps"), box_problem(3)
    writer = WriterProcess() if how == "writer" else None
    run = new_run(s, problem, (Recorder(path, s, problem, FakeVerifier(), writer=writer),))
    if writer is not None:
        print(writer.pid, flush=True)
    while not run.is_done:
        print(run.step().index, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
