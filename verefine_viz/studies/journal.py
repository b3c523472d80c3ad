"""What is done of a study: a line of JSON per unit, appended, so that a study that was stopped goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path

from pydantic import ValidationError

from verefine_viz.core.errors import InputError, UnavailableError
from verefine_viz.core.paths import try_lock
from verefine_viz.studies.solve_unit import Outcome
from verefine_viz.studies.study_plan import Unit


class Journal:
    """Of one study in one folder.

    Args:
        path: made if it is not there.
        about: what the study is (settings, frames), as it comes from JSON; a journal of something else is refused.

    Raises:
        InputError: the file belongs to another study, or cannot be written.
    """

    def __init__(self, path: Path, about: Mapping[str, object]) -> None:
        self._path = path
        self.done: dict[Unit, list[Outcome]] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = try_lock(path)
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
        if file is None:
            raise UnavailableError(f"another study is writing to {path}; wait for it or choose another --out")
        self._file = file
        try:
            n_bytes = self._read(about)
            self._cut(n_bytes)  # what was cut off in the middle of a line is solved again
            if not n_bytes:
                self._write(about)
        except OSError as error:
            self.close()
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
        except BaseException:
            self.close()
            raise

    def _read(self, about: Mapping[str, object]) -> int:
        """Takes over what is done; how many bytes of the file say it."""
        lines = self._file.read().splitlines(keepends=True)
        whole = [line for line in lines if line.endswith(b"\n")]
        if lines and not whole and not _line(about).startswith(lines[0]):
            raise InputError(f"{self._path} is no journal of a study; choose another --out, or delete it")
        try:
            if whole and json.loads(whole[0]) != about:
                raise InputError(
                    f"{self._path} belongs to a study with other settings; choose another --out, or delete it"
                )
            for entry in map(json.loads, whole[1:]):
                self.done[Unit(**entry["unit"])] = [Outcome.model_validate(row) for row in entry["outcomes"]]
        except (ValueError, KeyError, TypeError, RecursionError, ValidationError):
            raise InputError(f"{self._path} is no journal of a study; choose another --out, or delete it") from None
        return sum(map(len, whole))

    def add(self, unit: Unit, outcomes: list[Outcome]) -> None:
        """It is with the operating system when this returns.

        Raises:
            InputError: the disk does not take it.
        """
        self._write({"unit": asdict(unit), "outcomes": [o.model_dump() for o in outcomes]})
        self.done[unit] = outcomes

    def outcomes(self) -> Iterator[Outcome]:
        """All of them, in the order of the units, whoever was done first."""
        for unit in sorted(self.done):
            yield from self.done[unit]

    def close(self) -> None:
        self._file.close()

    def _write(self, content: Mapping[str, object]) -> None:
        """
        Raises:
            InputError: the disk does not take the line; none of it stays.
        """
        line, file = _line(content), self._file.fileno()
        begin = os.lseek(file, 0, os.SEEK_CUR)
        try:
            # A disk that is nearly full takes a part, and refuses when it is asked again.
            while line:
                line = line[os.write(file, line) :]
        except OSError as error:
            self._cut(begin)
            raise InputError(f"cannot write {self._path}: {error.strerror or error}") from None

    def _cut(self, n_bytes: int) -> None:
        """Leaves the first bytes, and goes on behind them."""
        os.truncate(self._file.fileno(), n_bytes)
        os.lseek(self._file.fileno(), n_bytes, os.SEEK_SET)


def _line(content: Mapping[str, object]) -> bytes:
    return json.dumps(content, separators=(",", ":")).encode() + b"\n"
