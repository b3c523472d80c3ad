"""What a person can ask for about the order in which objects are solved. Each restarts the run."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.viewer.command import Command


@dataclass(frozen=True)
class CutDependency(Command):
    """Let what is seen between two instances count no more, or count again."""

    first: int
    """instance_id."""
    second: int
    cut: bool = True


@dataclass(frozen=True)
class MoveInOrder(Command):
    """Solve an object one place earlier (−1) or later (+1).

    At the end of its cluster, the whole cluster changes places with the next one.
    """

    instance_id: int
    by: int


@dataclass(frozen=True)
class ResetOrder(Command):
    """Back to the order of the rule."""


ORDER_COMMANDS: tuple[type[Command], ...] = (CutDependency, MoveInOrder, ResetOrder)
