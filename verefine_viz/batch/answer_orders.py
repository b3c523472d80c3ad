"""Orders in which answers can be listed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from verefine_viz.core.causes import Cause
from verefine_viz.core.errors import SettingsError, unknown
from verefine_viz.run.record import Answer

Order = Literal["error", "score", "misleading", "cause", "object", "frame", "time", "undetermined"]
ORDERS: dict[Order, str] = {
    "error": "largest error",
    "score": "lowest score",
    "misleading": "wrong, highest score",
    "cause": "cause",
    "object": "object",
    "frame": "frame",
    "time": "longest time",
    "undetermined": "least certain turn",
}
"""Each order as the page calls it."""
WITHOUT_TRUTH: dict[Order, str] = {**ORDERS, "error": "most doubtful"}
del WITHOUT_TRUTH["misleading"]
"""The orders that mean something where no error is known, as the page calls them."""


def sort_key(order: Order) -> Callable[[Answer], tuple[Any, ...]]:
    """The key to sort rows by.

    error: failed frames, objects without an answer, then the largest error first. score: as error, but with the lowest
    score first. misleading: wrong answers, the highest score first. cause, object: by name, then by error. frame: in
    the order of the run. time: the longest first. undetermined: the largest ``undetermined_deg`` first. Error is
    ADD(-S) as a share of the diameter; objects without ground truth follow the others, by score.

    Raises:
        SettingsError: there is no such order.
    """
    if order not in ORDERS:
        raise SettingsError(unknown("order", order, ORDERS))
    return _SORT_KEYS[order]


def _by_error(row: Answer) -> tuple[int, float]:
    if row.status != "ok":
        return _by_score(row)
    if row.relative_error is None:
        return (3 if row.cause == Cause.IMPOSSIBLE else 4), row.score or 0.0
    return 2, -row.relative_error


def _by_score(row: Answer) -> tuple[int, float]:
    if row.status != "ok":
        return (0 if row.status == "failed" else 1), 0.0
    return 2, row.score or 0.0


_SORT_KEYS: dict[Order, Callable[[Answer], tuple[Any, ...]]] = {
    "error": _by_error,
    "score": _by_score,
    "misleading": lambda row: (row.is_correct is not False, -(row.score or 0.0)),
    "cause": lambda row: (not row.cause, row.cause, *_by_error(row)),
    "object": lambda row: (row.name, *_by_error(row)),
    "frame": lambda row: (),
    "time": lambda row: (-row.ms_total,),
    "undetermined": lambda row: (row.undetermined_deg is None, -(row.undetermined_deg or 0.0)),
}
