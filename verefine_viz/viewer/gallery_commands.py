"""What a person can ask for in the gallery of a batch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from verefine_viz.batch.index import Order
from verefine_viz.viewer.command import Command

BatchFilter = Literal["result", "cause", "object", "method", "run"]


@dataclass(frozen=True)
class OpenAt(Command):
    """A frame at one of its iterations, computed up to there if need be."""

    frame: str
    iteration: int
    run: str = ""
    """Of several batch runs the one whose session is opened; empty = the one that is open."""
    instance: int | None = None
    """instance_id of the object that is then in focus."""


@dataclass(frozen=True)
class OpenFailure(Command):
    """The next (+1) or previous (−1) answer of the gallery, in its order and among what its filters leave."""

    direction: int


@dataclass(frozen=True)
class OpenPoint(Command):
    """The answer whose point in the plot of score over error lies nearest."""

    u: int
    v: int


@dataclass(frozen=True)
class SortBatch(Command):
    """The order in which a batch's answers are listed."""

    order: Order


@dataclass(frozen=True)
class FilterBatch(Command):
    """Which of a batch's answers are listed; every filter counts until it is set to "all"."""

    by: BatchFilter
    value: str


@dataclass(frozen=True)
class TurnPage(Command):
    """Another page of the gallery, counted from 0."""

    latest_wins: ClassVar[bool] = True
    page: int
