"""What of a batch is on the disk: frames in the journal, recordings, and tables that say what the journal says."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

from verefine_viz.batch.journal import Journal
from verefine_viz.batch.rows import FRAMES_HEADER, FrameResult, file_stem, frames_lines, write_frames_csv
from verefine_viz.batch.totals import Totals
from verefine_viz.core.errors import InputError
from verefine_viz.core.paths import open_input
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.scenes.frames import parse_frame
from verefine_viz.scenes.results_csv import HEADER, ResultRow, results_line, write_results

TABLES = ("frames.csv", "results.csv")
Keep = Literal["all", "failures", "none"]


@dataclass(frozen=True)
class BatchFiles:
    """What is there and what is not."""

    totals: Totals
    """Of the frames that are in the journal."""
    missing: tuple[str, ...] = ()
    """Frames that are not."""
    damaged: tuple[str, ...] = ()
    """Why entries of such frames cannot be used, a sentence each."""
    can_be_mended: tuple[str, ...] = ()
    """Frames in the journal that another try may do better."""
    without_recording: tuple[str, ...] = ()
    """Frames in the journal whose recording should be there and is not."""
    other_tables: tuple[str, ...] = ()
    """Tables that are missing, or are not what the journal says."""

    @property
    def faults(self) -> tuple[str, ...]:
        """What a batch that came to its end has not written, a sentence each."""
        sentences = []
        if self.missing:
            n = len(self.missing)
            sentences.append(
                f"{n} frame{'s' * (n > 1)} of the session {'is' if n == 1 else 'are'} missing "
                f"({first_of(self.missing, MOST_NAMED)}): what was written of {'it' if n == 1 else 'them'} was deleted "
                "or damaged while the batch ran; the same command solves what is missing"
            )
        if self.other_tables:
            tables = " and ".join(self.other_tables)
            sentences.append(f"{tables} changed while the batch ran; the same command mends that")
        return tuple(sentences)

    @property
    def recordings_note(self) -> str:
        """Which recordings are missing and how to get them again; empty where none is."""
        n = len(self.without_recording)
        if not n:
            return ""
        return (
            f"{'the recording' if n == 1 else 'recordings'} of {n} frame{'s' * (n > 1)} "
            f"{'is' if n == 1 else 'are'} missing ({first_of(self.without_recording, MOST_NAMED)}); "
            f"the same command with --retry-failed makes {'it' if n == 1 else 'them'} again"
        )


def check_files(folder: Path, frames: Sequence[str], keep: Keep) -> BatchFiles:
    """What of ``frames`` is in the batch folder ``folder``, read once from the first to the last.

    Args:
        folder: the batch folder; it need not be there.
        frames: all of the session.
        keep: which recordings there should be.
    """
    journal, totals = Journal(folder / "frames"), Totals()
    recorded = {file.name for file in (folder / "recordings").glob("*.rrd")}
    missing, damaged, can_be_mended, without_recording = list[str](), list[str](), list[str](), list[str]()

    def results() -> Iterator[FrameResult]:
        for frame in frames:
            try:
                result = journal.entry(frame)
            except InputError as error:
                damaged.append(str(error))
                result = None
            if result is None:
                missing.append(frame)
                continue
            if result.can_be_mended:
                can_be_mended.append(frame)
            if _is_recorded(result, keep) and f"{file_stem(frame)}.rrd" not in recorded:
                without_recording.append(frame)
            yield result

    with ExitStack() as open_files:
        frames_table, results_table = (_Compared(open_files, folder / name) for name in TABLES)
        frames_table.expect(FRAMES_HEADER)
        results_table.expect(f"{HEADER}\n")
        for result in totals.passing(results()):
            frames_table.expect(frames_lines(result))
            results_table.expect("".join(map(results_line, result_rows(result))))
        others = tuple(table.name for table in (frames_table, results_table) if not table.is_as_expected())
    return BatchFiles(totals, tuple(missing), tuple(damaged), tuple(can_be_mended), tuple(without_recording), others)


def write_tables(folder: Path, frames: Sequence[str]) -> None:
    """Writes frames.csv and results.csv as the journal has them.

    Raises:
        InputError: the disk refuses.
    """
    journal = Journal(folder / "frames")
    write_frames_csv(folder / "frames.csv", journal.results(frames))
    write_results(folder / "results.csv", (row for result in journal.results(frames) for row in result_rows(result)))


def result_rows(result: FrameResult) -> Iterator[ResultRow]:
    """A frame's answers as results.csv has them, with the time of solving alone."""
    scene_id, im_id = parse_frame(result.frame)
    for e in result.estimates:
        T_cam_obj = np.array(e.T_cam_obj).reshape(4, 4)
        yield ResultRow(scene_id, im_id, e.obj_id, e.score, T_cam_obj, round(result.solving_s, 3))


class _Compared:
    """A table that is read on as long as it is what it should be."""

    def __init__(self, open_files: ExitStack, path: Path) -> None:
        self.name = path.name
        self._file: BinaryIO | None = None
        try:
            self._file = open_files.enter_context(open_input(path))
        except InputError:
            return  # It is not there, or no file.

    def expect(self, text: str) -> None:
        content = text.encode()
        if self._file is not None and self._file.read(len(content)) != content:
            self._file = None

    def is_as_expected(self) -> bool:
        """Whether it held all that was expected, and nothing more."""
        return self._file is not None and not self._file.read(1)


def _is_recorded(result: FrameResult, keep: Keep) -> bool:
    """Whether a frame leaves a recording; one that failed may leave none."""
    return not result.failed and (keep == "all" or (keep == "failures" and result.is_failure))
