"""What is done of a study: a line of JSON per unit, appended, so that a study that was stopped goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path

from pydantic import ValidationError

from verefine_viz.core.errors import InputError
from verefine_viz.studies.solve import Outcome
from verefine_viz.studies.study import Unit


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
            lines = path.read_bytes().splitlines(keepends=True) if path.exists() else []
            whole = [line for line in lines if line.endswith(b"\n")]
            if whole and json.loads(whole[0]) != about:
                raise InputError(f"{path} belongs to a study with other settings; choose another --out, or delete it")
            for entry in map(json.loads, whole[1:]):
                self.done[Unit(**entry["unit"])] = [Outcome.model_validate(row) for row in entry["outcomes"]]
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
            self._cut(sum(map(len, whole)))  # what was cut off in the middle of a line is solved again
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror or error}") from None
        except (ValueError, KeyError, TypeError, ValidationError):
            raise InputError(f"{path} is no journal of a study; choose another --out, or delete it") from None
        if not whole:
            try:
                self._write(about)
            except InputError:
                self.close()
                raise

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
        os.close(self._file)

    def _write(self, content: Mapping[str, object]) -> None:
        """
        Raises:
            InputError: the disk does not take the line; none of it stays.
        """
        line = json.dumps(content, separators=(",", ":")).encode() + b"\n"
        begin = os.lseek(self._file, 0, os.SEEK_CUR)
        try:
            # A disk that is nearly full takes a part, and refuses when it is asked again.
            while line:
                line = line[os.write(self._file, line) :]
        except OSError as error:
            self._cut(begin)
            raise InputError(f"cannot write {self._path}: {error.strerror or error}") from None

    def _cut(self, n_bytes: int) -> None:
        """Leaves the first bytes, and goes on behind them."""
        os.truncate(self._file, n_bytes)
        os.lseek(self._file, n_bytes, os.SEEK_SET)
