"""Answers as a table: a DataFrame where pandas is installed, else columns by name."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import msgspec.inspect as mi
import numpy as np

from verefine_viz.core.setting_types import fields_of
from verefine_viz.run.record import Answer

BEFORE, BEHIND = ("scene_id", "im_id"), ("cause", "evidence", "right")
"""Columns beside the fields of an answer."""


def table_of(answers: Sequence[Answer]) -> Any:
    """A row for each answer: its fields, BOP's ``scene_id`` and ``im_id``, ``cause``, ``evidence``, and ``right``.

    ``right`` is False for a missing answer, and unknown without ground truth.

    Returns:
        A DataFrame in which an unknown number is NaN and an unknown truth value NA; without pandas, a dict from column
        name to list, with None for what is unknown.
    """
    columns = columns_of(answers)
    if find_spec("pandas") is None:
        return columns
    pandas: Any = import_module("pandas")
    kinds = {name: field.type for name, field in fields_of(Answer).items()}
    return pandas.DataFrame({name: _series(values, kinds.get(name), pandas) for name, values in columns.items()})


def columns_of(answers: Sequence[Answer]) -> dict[str, list[Any]]:
    """The columns by name; None where something is unknown."""
    columns = {name: [getattr(one, name) for one in answers] for name in (*BEFORE, *Answer.__struct_fields__)}
    columns |= {name: [getattr(one, name) for one in answers] for name in BEHIND[:-1]}
    return columns | {BEHIND[-1]: [one.is_correct is True if one.can_be_right else None for one in answers]}


def _series(values: list[Any], kind: mi.Type | None, pandas: Any) -> Any:
    """A column with the type of its field; ``right`` holds truth values, some of them unknown."""
    parts = kind.types if isinstance(kind, mi.UnionType) else (kind,)
    if any(isinstance(part, mi.FloatType) for part in parts) or (
        any(value is None for value in values) and any(isinstance(part, mi.IntType) for part in parts)
    ):
        return np.array([np.nan if value is None else value for value in values], np.float64)
    if kind is None and all(value is None or isinstance(value, bool) for value in values):
        return pandas.array(values, dtype="boolean")
    if len(parts) > 1 and any(isinstance(part, mi.BoolType) for part in parts):
        return pandas.array(values, dtype="boolean")
    return pandas.Series(values, dtype=None if values else object)
