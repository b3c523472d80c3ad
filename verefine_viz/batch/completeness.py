"""What of a batch is on the disk: run files, recordings, and tables that say what the run files say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from verefine_viz.batch.kept_recordings import KeptRecordings
from verefine_viz.batch.runs import Runs, file_stem
from verefine_viz.batch.totals import Totals
from verefine_viz.core.errors import InputError
from verefine_viz.core.files import opened
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.run.answers import HEADER, result_rows, table_lines, write_table
from verefine_viz.run.record import RunRecord
from verefine_viz.scenes.results_csv import HEADER as RESULTS_HEADER
from verefine_viz.scenes.results_csv import results_line, write_results

TABLES = ("frames.csv", "results.csv")


@dataclass(frozen=True)
class BatchFiles:
    """What is there and what is not."""

    totals: Totals
    """Totals of the frames that are finished."""
    missing: tuple[str, ...] = ()
    """Frames that are not."""
    damaged: tuple[str, ...] = ()
    """Why run files of such frames cannot be used, a sentence each."""
    can_be_mended: tuple[str, ...] = ()
    """Finished frames that another try may do better."""
    without_recording: tuple[str, ...] = ()
    """Finished frames whose recording should be there and is not."""
    n_recorded: int = 0
    """Finished frames whose recording is there."""
    n_not_kept: int = 0
    """Finished frames whose recording is not there, and need not be."""
    recorded_bytes: int = 0
    """Size of the recordings."""
    other_tables: tuple[str, ...] = ()
    """Tables that are missing, or are not what the run files say."""

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


def check_files(folder: Path, frames: Sequence[str], kept: KeptRecordings) -> BatchFiles:
    """What of ``frames`` is in the batch folder ``folder``, read once from the first to the last.

    Args:
        folder: the batch folder; it need not be there.
        frames: all of the session.
        kept: which recordings there should be.
    """
    runs, totals = Runs(folder / "runs"), Totals()
    recorded = {file.name: file.stat().st_size for file in (folder / "recordings").glob("*.rrd")}
    n_recorded = n_not_kept = 0
    missing, damaged, can_be_mended, without_recording = list[str](), list[str](), list[str](), list[str]()

    def records() -> Iterator[RunRecord]:
        nonlocal n_recorded, n_not_kept
        for frame in frames:
            try:
                record = runs.entry(frame)
            except InputError as error:
                damaged.append(str(error))
                record = None
            if record is None or record.end is None:
                missing.append(frame)
                continue
            if record.end.can_be_mended:
                can_be_mended.append(frame)
            if f"{file_stem(frame)}.rrd" in recorded:
                n_recorded += 1
            elif kept.holds(frame, record.end):
                without_recording.append(frame)
            else:
                n_not_kept += not record.end.failed
            yield record

    with ExitStack() as open_files:
        frames_table, results_table = (_Compared(open_files, folder / name) for name in TABLES)
        frames_table.expect(HEADER)
        results_table.expect(f"{RESULTS_HEADER}\n")
        for record in totals.passing(records()):
            frames_table.expect(table_lines(record))
            results_table.expect("".join(map(results_line, result_rows(record))))
        others = tuple(table.name for table in (frames_table, results_table) if not table.is_as_expected())
    return BatchFiles(
        totals, tuple(missing), tuple(damaged), tuple(can_be_mended), tuple(without_recording),
        n_recorded, n_not_kept, sum(recorded.values()), others,
    )  # fmt: skip


def write_tables(folder: Path, frames: Sequence[str]) -> None:
    """Writes frames.csv and results.csv as the run files have them.

    Raises:
        InputError: the disk refuses.
    """
    runs = Runs(folder / "runs")
    write_table(folder / "frames.csv", runs.records(frames))
    write_results(folder / "results.csv", (row for record in runs.records(frames) for row in result_rows(record)))


class _Compared:
    """A table that is read on as long as it is what it should be."""

    def __init__(self, open_files: ExitStack, path: Path) -> None:
        self.name = path.name
        self._file: BinaryIO | None = None
        try:
            self._file = open_files.enter_context(opened(path))
        except InputError:
            return  # It is not there, or no file.

    def expect(self, text: str) -> None:
        content = text.encode()
        if self._file is not None and self._file.read(len(content)) != content:
            self._file = None

    def is_as_expected(self) -> bool:
        """Whether it held all that was expected, and nothing more."""
        return self._file is not None and not self._file.read(1)
