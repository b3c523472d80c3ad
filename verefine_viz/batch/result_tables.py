"""The tables of a batch, written or compared frame by frame: frames.csv, results.csv, frames.parquet."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol

import msgspec.inspect as mi

from verefine_viz.core.errors import InputError
from verefine_viz.core.files import opened
from verefine_viz.core.writing import atomic
from verefine_viz.run.answers import COLUMNS, HEADER, result_rows, table_lines
from verefine_viz.run.record import Answer, RunRecord
from verefine_viz.scenes.results_csv import HEADER as RESULTS_HEADER
from verefine_viz.scenes.results_csv import results_line

if TYPE_CHECKING:
    import pyarrow as pa

FRAMES, RESULTS, PARQUET = "frames.csv", "results.csv", "frames.parquet"
TABLES = (FRAMES, RESULTS, PARQUET)
ROWS_AT_ONCE = 20_000
"""Rows of frames.parquet that wait in memory."""


class Table(Protocol):
    """A table that takes the records of a batch one after the other."""

    def add(self, record: RunRecord) -> None:
        """Take a finished frame."""


def _beginning_of(name: str) -> str:
    """The first line of a CSV table."""
    return HEADER if name == FRAMES else f"{RESULTS_HEADER}\n"


def lines_of(name: str, record: RunRecord) -> str:
    """The lines of a CSV table about a frame."""
    return table_lines(record) if name == FRAMES else "".join(map(results_line, result_rows(record)))


class ComparedTable:
    """A CSV table on the disk that is compared with what it should hold, up to the first difference."""

    def __init__(self, open_files: ExitStack, path: Path) -> None:
        self.name = path.name
        self._file: BinaryIO | None = None
        try:
            self._file = open_files.enter_context(opened(path))
        except InputError:
            return  # It is not there, or no file.
        self._expect(_beginning_of(self.name))

    def add(self, record: RunRecord) -> None:
        self._expect(lines_of(self.name, record))

    def _expect(self, text: str) -> None:
        content = text.encode()
        if self._file is not None and self._file.read(len(content)) != content:
            self._file = None

    def is_as_expected(self) -> bool:
        """Whether the file holds all that was expected, and nothing more."""
        return self._file is not None and not self._file.read(1)


class WrittenTable:
    """A CSV table that appears under its name when ``open_files`` closes without an error."""

    def __init__(self, open_files: ExitStack, path: Path) -> None:
        self._name = path.name
        part = open_files.enter_context(atomic(path))
        self._file = open_files.enter_context(part.open("wb"))
        self._file.write(_beginning_of(self._name).encode())

    def add(self, record: RunRecord) -> None:
        self._file.write(lines_of(self._name, record).encode())


class ParquetTable:
    """frames.parquet: the columns of frames.csv with their types and all digits; null = unknown."""

    def __init__(self, open_files: ExitStack, path: Path) -> None:
        import pyarrow.parquet as pq

        part = open_files.enter_context(atomic(path))
        self._schema = schema()
        self._writer = open_files.enter_context(pq.ParquetWriter(part, self._schema, compression="zstd"))
        self._rows: list[Answer] = []
        open_files.callback(self._write)

    def add(self, record: RunRecord) -> None:
        self._rows.extend(record.end.answers if record.end is not None else ())
        if len(self._rows) >= ROWS_AT_ONCE:
            self._write()

    def _write(self) -> None:
        import pyarrow as pa

        columns = [[getattr(row, name) for row in self._rows] for name in self._schema.names]
        arrays = [pa.array(column, kind) for column, kind in zip(columns, self._schema.types, strict=True)]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))
        self._rows = []


def schema() -> pa.Schema:
    """Names and types of the columns of frames.parquet."""
    import pyarrow as pa

    kinds = {field.name: field.type for field in mi.type_info(Answer).fields}  # type: ignore[union-attr]
    return pa.schema([(column.name, _arrow_type(column.name, kinds.get(column.name))) for column in COLUMNS])


def _arrow_type(name: str, kind: mi.Type | None) -> pa.DataType:
    import pyarrow as pa

    types: dict[Any, pa.DataType] = {
        mi.FloatType: pa.float64(), mi.IntType: pa.int64(), mi.BoolType: pa.bool_(),
    }  # fmt: skip
    if name in ("scene_id", "im_id"):  # Parts of the frame's name.
        return pa.int64()
    parts = kind.types if isinstance(kind, mi.UnionType) else (kind,)
    return next((types[type(part)] for part in parts if type(part) in types), pa.string())
