"""Checks what a batch has on the disk: run files, recordings, and tables that agree with the run files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from verefine_viz.batch.answer_index import WrittenIndex
from verefine_viz.batch.kept_recordings import KeptRecordings
from verefine_viz.batch.result_tables import (
    FRAMES,
    PARQUET,
    RESULTS,
    ComparedTable,
    ParquetTable,
    Table,
    WrittenTable,
)
from verefine_viz.batch.runs import Runs, file_stem
from verefine_viz.batch.totals import Totals
from verefine_viz.core.errors import InputError
from verefine_viz.core.text_format import MOST_NAMED, first_of
from verefine_viz.run.record import RunRecord


@dataclass(frozen=True)
class BatchFiles:
    """What a batch folder holds, and what is missing or damaged."""

    totals: Totals
    """Totals of the finished frames."""
    missing: tuple[str, ...] = ()
    """Frames that are not finished."""
    damaged: tuple[str, ...] = ()
    """Why run files of missing frames cannot be used, a sentence each."""
    can_be_mended: tuple[str, ...] = ()
    """Finished frames that another try may improve."""
    without_recording: tuple[str, ...] = ()
    """Finished frames whose recording is missing."""
    n_recorded: int = 0
    """Finished frames that have a recording."""
    n_not_kept: int = 0
    """Finished frames that have no recording, and need none."""
    recorded_bytes: int = 0
    """Size of all recordings."""
    other_tables: tuple[str, ...] = ()
    """Tables that are missing, or disagree with the run files."""

    @property
    def faults(self) -> tuple[str, ...]:
        """What is missing although the batch ran to its end, a sentence each."""
        n = len(self.missing)
        if not n:
            return ()
        return (
            f"{n} frame{'s' * (n > 1)} of the session {'is' if n == 1 else 'are'} missing "
            f"({first_of(self.missing, MOST_NAMED)}): what was written of {'it' if n == 1 else 'them'} was deleted "
            "or damaged while the batch ran; the same command solves what is missing",
        )

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
    """Compare a batch folder with the frames of its session; run files are read once, in order.

    Args:
        folder: the batch folder; it need not exist.
        frames: all frames of the session.
        kept: which frames should have a recording.
    """
    with ExitStack() as open_files:
        compared = [ComparedTable(open_files, folder / name) for name in (FRAMES, RESULTS)]
        files = _read(folder, frames, kept, compared)
        others = [table.name for table in compared if not table.is_as_expected()]
    others += [PARQUET] if not (folder / PARQUET).is_file() else []
    return replace(files, other_tables=tuple(others))


def write_tables(folder: Path, frames: Sequence[str], kept: KeptRecordings) -> BatchFiles:
    """Write all tables of a batch from its run files, which are read once; return what the folder then holds.

    Raises:
        InputError: the disk refuses.
    """
    with ExitStack() as open_files:
        written: list[Table] = [WrittenTable(open_files, folder / name) for name in (FRAMES, RESULTS)]
        written += [ParquetTable(open_files, folder / PARQUET), WrittenIndex(open_files, folder)]
        return _read(folder, frames, kept, written)


def _read(folder: Path, frames: Sequence[str], kept: KeptRecordings, tables: Sequence[Table]) -> BatchFiles:
    """What the folder holds of ``frames``; each finished record is added to the tables on the way."""
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

    for record in totals.passing(records()):
        for table in tables:
            table.add(record)
    return BatchFiles(
        totals, tuple(missing), tuple(damaged), tuple(can_be_mended), tuple(without_recording),
        n_recorded, n_not_kept, sum(recorded.values()),
    )  # fmt: skip
