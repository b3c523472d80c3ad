"""Draws recordings from run files by worker processes, so that those a batch did not keep can be made later."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from verefine_viz.batch.index import batch_of
from verefine_viz.batch.runs import Runs, file_stem
from verefine_viz.batch.worker_pool import Pool
from verefine_viz.core.errors import InputError, VerefineError, one_line
from verefine_viz.core.progress_token import ProgressToken
from verefine_viz.run.run_file import SUFFIX


@dataclass(frozen=True)
class ToDraw:
    """A run file and where its recording goes."""

    run: Path
    recording: Path


@dataclass(frozen=True)
class DrawnRun:
    """A run file whose recording was drawn, or why it was not."""

    of: ToDraw
    fault: str = ""
    """Why there is no recording; empty where there is one."""


@dataclass(frozen=True)
class DrawWork:
    """The work of drawing: see :class:`verefine_viz.batch.worker_tasks.Work`."""

    def begin(self, progress: ProgressToken) -> Callable[[ToDraw, Callable[[], None]], DrawnRun]:
        from verefine_viz.batch.draw_run_file import RunDrawer

        drawer = RunDrawer()

        def draw(one: ToDraw, compiling: Callable[[], None]) -> DrawnRun:
            try:
                drawer.draw(one.run, one.recording)
            except VerefineError as error:
                return DrawnRun(one, one_line(str(error)))
            except Exception as error:
                return DrawnRun(one, one_line(f"{one.run}: {type(error).__name__}: {error}"))
            return DrawnRun(one)

        return draw

    def lost(self, item: ToDraw, why: str) -> DrawnRun:
        return DrawnRun(item, f"{item.run}: {why}")

    def line_of(self, item: ToDraw) -> None:
        """Run files can be drawn in any order."""


def to_draw(path: Path) -> tuple[ToDraw, ...]:
    """The run file ``path``, or those in a batch folder whose frame has no recording and did not fail.

    Recordings of a batch lie in its ``recordings/``, others beside their run file.

    Raises:
        InputError: ``path`` is neither.
    """
    if not path.is_dir():
        if path.suffix != SUFFIX:
            raise InputError(
                f"{path} is no run file ({SUFFIX}) and no folder of a batch; --draw makes recordings of those"
            )
        is_of_batch = path.parent.name == "runs" and batch_of(path.parent) != path.parent
        folder = path.parent.parent / "recordings" if is_of_batch else path.parent
        return (ToDraw(path, folder / path.with_suffix(".rrd").name),)
    runs = Runs(batch_of(path) / "runs")
    if not runs.frames:
        raise InputError(f"{path} holds no run of a batch; expected the folder of a batch, or a run file ({SUFFIX})")
    recordings = runs.folder.parent / "recordings"
    there = {file.stem for file in recordings.glob("*.rrd")}
    missing = [frame for frame in runs.frames if file_stem(frame) not in there]
    finished = [one.header.frame for one in runs.records(missing) if one.end is not None and not one.end.failed]
    return tuple(ToDraw(runs.path(frame), recordings / f"{file_stem(frame)}.rrd") for frame in finished)


def draw_recordings(
    wanted: Sequence[ToDraw], n_workers: int, report: Callable[[str, int, int], None]
) -> Iterator[DrawnRun]:
    """Draw recordings; yields each run file as it is done.

    Args:
        wanted: which ones.
        n_workers: most processes.
        report: called with what is being made, how many are done, and of how many.
    """
    with closing(Pool(DrawWork(), n_workers)) as pool:
        n_done = 0
        report("recordings", 0, len(wanted))
        for result in pool.solve(wanted):
            if isinstance(result, DrawnRun):
                n_done += 1
                report("recordings", n_done, len(wanted))
                yield result
