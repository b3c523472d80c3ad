"""Many frames at once: solved into a folder, opened again as tables and runs, reported."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec import structs

from verefine_viz.batch.frame_work import FrameWork
from verefine_viz.batch.index import BatchIndex, batch_of, read_batch
from verefine_viz.batch.jobs import check_outside
from verefine_viz.batch.progress import BatchProgress
from verefine_viz.batch.run_batch import Backend, BatchStatus, run_batch
from verefine_viz.batch.runs import RUN_FILE, Runs
from verefine_viz.batch.this_process import ThisProcess
from verefine_viz.batch.worker_tasks import MOST_PER_CORE, TaskName
from verefine_viz.core.arguments import (
    checked_count,
    checked_flag,
    checked_mapping,
    checked_path,
    checked_text,
    described,
)
from verefine_viz.core.console import ProgressBar
from verefine_viz.core.errors import ArgumentTypeError, InputError, unknown
from verefine_viz.core.settings import Session
from verefine_viz.library.frame_to_solve import AnyFrame, Frame, OpenedFrame, session_at, taken
from verefine_viz.library.pictures import MOST_SHOWN, PicturedAnswer, gallery, pictured
from verefine_viz.library.plugins import with_parts
from verefine_viz.library.solving import Run, open_run
from verefine_viz.library.tables import table_of
from verefine_viz.run.record import Answer
from verefine_viz.run.run_file import SUFFIX

if TYPE_CHECKING:
    from typing import Unpack

    from verefine_viz.library.plugins import AnyEstimator, AnyRefiner, AnySimulator, AnyVerifier
    from verefine_viz.library.sections import MethodName, MethodSection, OtherSections
    from verefine_viz.report.write_report import Report

MOST_EMBEDDED, MOST_PICTURES = 200, 10_000
"""The largest numbers that a report takes: they come to 600 MB of frames, and 80 MB of pictures."""
FOLDER = "the folder of a batch"


class BatchRuns(Mapping[str, Run]):
    """The runs of a batch by frame, "scene/image"; each is read when it is asked for.

    In a folder of nothing but run files, runs are named after the files, without the ending.
    """

    def __init__(self, index: BatchIndex) -> None:
        self._files = _files(index)

    def __getitem__(self, frame: str) -> Run:
        """The run of a frame; InputError where the batch has none, or its file is damaged."""
        name = checked_text(frame, "frame", 'its name, as "50/1"')
        if name not in self._files:
            raise InputError(unknown("frame", name, self._files))
        return open_run(self._files[name])

    def __contains__(self, frame: object) -> bool:
        return frame in self._files

    def __iter__(self) -> Iterator[str]:
        return iter(self._files)

    def __len__(self) -> int:
        return len(self._files)

    def __repr__(self) -> str:
        return f"<{len(self)} runs: {', '.join([*self][:3])}{', …' * (len(self) > 3)}>"


def _files(index: BatchIndex) -> dict[str, Path]:
    """The run file of each frame; in a folder of run files, each file by its name."""
    if not (index.folder / RUN_FILE).is_file():
        return {path.stem: path for path in sorted(index.folder.glob(f"*{SUFFIX}"))}
    runs = Runs(index.folder / "runs")
    return {frame: runs.path(frame) for frame in dict.fromkeys(row.frame for row in index.rows)}


class Batch(os.PathLike[str]):
    """The results of a batch; :func:`batch` and :func:`open_batch` make them. ``os.fspath`` gives its folder.

    Args:
        index: what is in the folder.
    """

    def __init__(self, index: BatchIndex) -> None:
        if not isinstance(index, BatchIndex):
            raise ArgumentTypeError(f"a batch is made by batch and open_batch, not of {described(index)}")
        self._index = index

    @property
    def folder(self) -> Path:
        """The folder with its tables, run files, recordings and ``session.toml``."""
        return self._index.folder

    @property
    def session(self) -> Session:
        """The settings that it ran with, all of them explicit."""
        return self._index.session

    @cached_property
    def answers(self) -> tuple[Answer, ...]:
        """The answer about each object, frame by frame; a frame that failed may have one that names no object."""
        return tuple(pictured(answer, self._picture) for answer in self._index.rows)

    @property
    def failures(self) -> tuple[Answer, ...]:
        """The answers that are missing or wrong, the worst first: ADD(-S) not below 10 % of the diameter."""
        shown = {id(row): answer for row, answer in zip(self._index.rows, self.answers, strict=True)}
        return tuple(shown[id(row)] for row in self._index.sorted_by("error") if row.is_failure)

    @cached_property
    def runs(self) -> BatchRuns:
        """The runs, by frame: ``batch.runs["50/1"].iterations``."""
        return BatchRuns(self._index)

    @property
    def notes(self) -> tuple[str, ...]:
        """What is missing: frames that are not finished, files that cannot be read."""
        return self._index.notes

    def to_frame(self) -> Any:
        """The answers as a table, a row for each, as :meth:`Run.to_frame` has them."""
        return table_of(self._index.rows)

    def __fspath__(self) -> str:
        return str(self.folder)

    def __repr__(self) -> str:
        n, wrong = len(self._index.rows), sum(row.is_failure for row in self._index.rows)
        return f"<Batch of {self.session.method.name} in {self.folder}: {n} answers, {wrong} wrong or missing>"

    def _repr_html_(self) -> str:
        failures = self.failures or self.answers
        return gallery(repr(self).strip("<>"), [a for a in failures[:MOST_SHOWN] if isinstance(a, PicturedAnswer)])

    def _picture(self, answer: Answer) -> bytes:
        return self.runs[answer.frame]._picture(answer) if answer.frame in self.runs else b""


def open_batch(folder: Path | str | os.PathLike[str]) -> Batch:
    """Open the results of a batch.

    Args:
        folder: what :func:`batch`, or ``verefine-viz batch --out FOLDER``, has written; or a folder of run files.

    Returns:
        ``answers`` of all objects, ``failures`` among them, ``runs`` by frame, ``to_frame()`` for a table.

    Raises:
        InputError: the folder is no batch, or a file in it is missing or damaged.
    """
    return Batch(read_batch(batch_of(checked_path(folder, "folder", FOLDER))))


def batch(
    what: Path | str | AnyFrame | Iterable[AnyFrame],
    out: Path | str,
    workers: int = 1,
    method: MethodName | MethodSection | None = None,
    refiner: AnyRefiner = "",
    preset: str = "",
    verifier: AnyVerifier = "",
    simulator: AnySimulator = "",
    estimator: AnyEstimator = "",
    diagnose: bool = True,
    retry_failed: bool = False,
    progress: bool = True,
    **sections: Unpack[OtherSections],
) -> Batch:
    """Solve many frames into a folder, as ``verefine-viz batch`` does.

    After a stop or kill, the same call goes on where it ended; where nothing is left to do, it opens the results.
    Frames of arrays are written as traces into a folder beside ``out``, named like it with ``-frames`` appended;
    ``out`` must then be new.

    Args:
        what: what ``verefine-viz view`` opens (a data set, a session, traces, …), the name of a built-in scene, or
            frames.
        out: the folder of the results.
        workers: processes that solve frames; 1 = this one. In a script, a call with more than one belongs below ``if
            __name__ == "__main__":``.
        method: its name, or its section; None = that of the session.
        refiner: icp, depth_net, …; or your own, by name or, with one worker, as an object; "" = the default.
        preset: recommended, paper, published; "" = recommended.
        verifier: one of your own in place of Eq. 1.
        simulator: one of your own in place of Bullet.
        estimator: what makes the initial poses; "" = those of the data.
        diagnose: whether wrong answers get their cause where ground truth is known, which takes re-runs.
        retry_failed: whether frames that failed before are tried again.
        progress: whether stderr shows how far it is.
        sections: other settings, each section a dict as in a session file: ``recording={"keep": "none"}``.

    Returns:
        The answers as tables and runs, as :func:`open_batch` has them.

    Raises:
        VerefineError: the data, the settings or the folder cannot be used. A frame that fails does not raise.
    """
    folder = checked_path(out, "out", FOLDER)
    n = _checked_workers(workers)
    task: TaskName = "explain" if checked_flag(diagnose, "diagnose") else "solve"
    checked_flag(retry_failed, "retry_failed")
    checked_flag(progress, "progress")
    if method is not None:
        given = {"name": method} if isinstance(method, str) else method
        sections = {**sections, "method": checked_mapping(given, "method", "its name, or its section, or None")}  # type: ignore[assignment]
    settings: dict[str, Any] = {
        **({"preset": preset} if checked_text(preset, "preset", "its name") else {}),
        **sections,
    }
    parts = {"refiner": refiner, "verifier": verifier, "simulator": simulator, "estimator": estimator}
    settings, own = taken(with_parts(settings, **parts))
    if own and n > 1:
        raise InputError(
            f"workers is {n}, but other processes do not have the parts of this one; leave workers out, or register "
            "the class by a name"
        )
    session = _session(what, folder, settings)
    check_outside(folder, session)
    with _shown(folder, progress) as report:
        workers_here = ThisProcess(FrameWork(session, folder.absolute(), task)) if n == 1 else None
        run_batch(session, folder, Backend(n), report, retry_failed, task, workers_here)
    return open_batch(folder)


@contextmanager
def _shown(folder: Path, is_shown: bool) -> Iterator[Callable[[BatchStatus], None]]:
    """Where a batch reports its progress."""
    if not is_shown:
        yield lambda _: None
        return
    with BatchProgress().run(folder.name) as doing:
        yield doing


def _session(what: Any, out: Path, settings: Mapping[str, Any]) -> Session:
    """The session over what is to be solved."""
    if isinstance(what, str | os.PathLike):
        return session_at(what if isinstance(what, str) else Path(what), settings)
    frames = [what] if isinstance(what, Frame | OpenedFrame) else [*what] if isinstance(what, Iterable) else []
    opened = [frame for frame in frames if isinstance(frame, OpenedFrame)]
    arrays = [frame for frame in frames if isinstance(frame, Frame)]
    if frames and len(opened) == len(frames):
        return _of_opened(opened, settings)
    if frames and len(arrays) == len(frames):
        return _of_arrays(arrays, out, settings)
    expected = "a path, a built-in scene, or frames that are all opened, or all of arrays"
    raise ArgumentTypeError(f"what is {described(what)}, expected {expected}")


def _of_opened(frames: Sequence[OpenedFrame], settings: Mapping[str, Any]) -> Session:
    if any(not frame.is_beside(frames[0]) for frame in frames):
        raise InputError(
            "the frames are of several data sets, or were opened with other settings; solve each by itself"
        )
    scene = {**settings.get("scene", {}), "frames": [frame.name for frame in frames]}
    return frames[0].tools({**settings, "scene": scene})[0].session


def _of_arrays(frames: Sequence[Frame], out: Path, settings: Mapping[str, Any]) -> Session:
    beside = out.with_name(f"{out.name}-frames")
    for folder in (out, beside):
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise InputError(
                f"{folder} is there already; frames of arrays begin a batch of their own: choose another out"
            )
    has_poses = all(frame.has_poses for frame in frames)
    for k, frame in enumerate(frames, 1):
        frame.save(beside / f"frame_{k:06d}")
    sessions = [frame.tools(settings)[0].session for frame in frames[:1]]
    scene = structs.replace(sessions[0].scene, source="folder", dataset=str(beside.resolve()))
    hypotheses = sessions[0].hypotheses
    if "source" not in settings.get("hypotheses", {}):
        hypotheses = structs.replace(hypotheses, source="recorded" if has_poses else "ppf")
    return structs.replace(sessions[0], title=out.name, scene=scene, hypotheses=hypotheses)


def report(
    what: Path | str | os.PathLike[str],
    against: Path | str | os.PathLike[str] | None = None,
    out: Path | str | None = None,
    embed: int = 8,
    beside: int = 0,
    pictures: int = 300,
    workers: int = 1,
    progress: bool = True,
) -> Report:
    """Write the report of a batch, of two side by side, or of many compared, as ``verefine-viz report`` does.

    Args:
        what: a batch, its folder, or a folder of several.
        against: another one to compare with.
        out: the HTML file; None = ``report.html`` in the folder, for two ``report-against-NAME.html``.
        embed: frames with a wrong answer that open in the file, the worst first, at most 200.
        beside: further ones that get a file each, in a folder beside it, at most 200.
        pictures: answers that have a picture, the worst first, at most 10 000.
        workers: threads for the BOP scores; they are the same for any number.
        progress: whether stderr shows how far it is.

    Returns:
        ``path`` of the file, its ``headlines``, and ``notes`` on what is missing in it.

    Raises:
        VerefineError: a folder is no batch, or the file cannot be written.
    """
    from verefine_viz.report.report_tools import report_tools
    from verefine_viz.report.write_report import report_of

    folder = checked_path(what, "what", FOLDER)
    other = None if against is None else checked_path(against, "against", FOLDER)
    file = None if out is None else checked_path(out, "out", "the name of an HTML file")
    embed, beside = checked_count(embed, "embed", 0, MOST_EMBEDDED), checked_count(beside, "beside", 0, MOST_EMBEDDED)
    pictures = checked_count(pictures, "pictures", 0, MOST_PICTURES)
    tools = report_tools(_checked_workers(workers))
    with ProgressBar("reading") if checked_flag(progress, "progress") else nullcontext() as bar:
        doing = (lambda what, done, of: None) if bar is None else bar.show
        return report_of(folder, other, file, embed, beside, pictures, tools, doing)


def _checked_workers(workers: int) -> int:
    return checked_count(workers, "workers", 1, MOST_PER_CORE * (os.cpu_count() or 1))
