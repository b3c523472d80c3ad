"""The folder of a study: ``study.json``, which study it is, and the finished units, a file each."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from verefine_viz.batch.folder import take_folder
from verefine_viz.core.arrays import Float
from verefine_viz.core.errors import InputError
from verefine_viz.core.files import read_json
from verefine_viz.core.writing import atomic, clear_parts, write_json
from verefine_viz.studies.solve_unit import UnitAnswer
from verefine_viz.studies.study_plan import Unit

STUDY_FILE = "study.json"
"""Which study, its curves, and the sessions of its scenes."""


class UnitResult(msgspec.Struct, frozen=True):
    """What a unit came to."""

    unit: Unit
    outcomes: tuple[UnitAnswer, ...]
    failure: str = ""
    """Why it has none; such a unit is never saved."""


def _pose(kind: object, rows: object) -> Float:
    return np.array(rows, dtype=np.float64).reshape(4, 4)


class StudyFolder:
    """A folder that this process alone writes to until :meth:`close`.

    Args:
        path: made if it is not there.
        about: what the study is, as it comes from JSON.

    Raises:
        InputError: the folder holds something else, or a study with other settings, or cannot be written.
        UnavailableError: another process is writing to it.
    """

    def __init__(self, path: Path, about: Mapping[str, object]) -> None:
        self._path = path
        self.n_unreadable = 0
        """Files of units that are damaged or of another version, among those read."""
        self._lock = take_folder(path, STUDY_FILE, "study")
        try:
            self._check_study(about)
            clear_parts(path)
        except BaseException:
            self.close()
            raise

    def read(self, unit: Unit) -> UnitResult | None:
        """What a unit came to; None where it is not finished, or its file is damaged."""
        file = self._file(unit)
        if not file.exists():
            return None
        with suppress(InputError, msgspec.ValidationError):
            result = msgspec.convert(read_json(file, dict[str, Any]), UnitResult, dec_hook=_pose)
            return result if result.unit == unit else None
        self.n_unreadable += 1
        return None

    def save(self, result: UnitResult) -> None:
        """Notes a finished unit; from now on a restart does not repeat it.

        Raises:
            InputError: the disk refuses.
        """
        with atomic(self._file(result.unit)) as part:
            part.write_bytes(msgspec.json.encode(result, enc_hook=np.ndarray.tolist))

    def close(self) -> None:
        """Lets others write to the folder."""
        self._lock.close()

    def _file(self, unit: Unit) -> Path:
        return self._path / f"{unit.stem}.json"

    def _check_study(self, about: Mapping[str, object]) -> None:
        file = self._path / STUDY_FILE
        if not file.exists():
            write_json(file, about)
        elif read_json(file, dict[str, Any]) != about:
            raise InputError(f"{self._path} belongs to a study with other settings; choose another --out, or delete it")
