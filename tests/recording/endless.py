"""A recorded run for a test to kill: prints each iteration once its recorder has returned."""

from __future__ import annotations

import sys
from pathlib import Path

from tests.fakes import FakeVerifier, box_problem
from tests.recording.runs import new_run, session
from verefine_viz.recording.recorder import Recorder
from verefine_viz.run.run_file import SUFFIX, RunFile


def main(path: Path, maps: bool) -> None:
    s, problem = session(iterations=1000, maps=maps), box_problem(3)
    file = RunFile(path.with_suffix(SUFFIX), s)
    run = new_run(s, problem, (file, Recorder(path, s, problem, lambda _: FakeVerifier())))
    while not run.is_done:
        print(run.step().index, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2] == "maps")
