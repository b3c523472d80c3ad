"""What a study is: panels of curves, what the paper claims about them, and the units of work they make."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from verefine_viz.core.problem import Problem

Settings = Mapping[str, Mapping[str, Any]]
"""Changed fields of a session by section."""
Prepare = Callable[[Problem, float, int], Problem]
"""(frame, x, seed) → the frame as it is at this x."""


@dataclass(frozen=True)
class Curve:
    """One method with its budget."""

    label: str
    settings: Settings | None
    """Sections ``method``, ``icp``, ``tricp``, ``mcts``, ``physics``, ``score``; None: the first initial pose is the
    answer, unrefined."""


@dataclass(frozen=True)
class Claim:
    """What the paper reports of two curves: ``better`` lies above ``worse``, on average over the panel."""

    better: str
    worse: str


@dataclass(frozen=True)
class Panel:
    """One diagram: every curve at every x."""

    name: str
    x_label: str
    xs: tuple[float, ...]
    curves: tuple[Curve, ...]
    prepare: Prepare = field(repr=False)
    claims: tuple[Claim, ...] = ()
    trend: str = ""
    """What the paper reports, in a sentence."""
    is_grasped: bool = False
    """Whether every answer is tried with the simulated gripper."""


@dataclass(frozen=True)
class Study:
    """All diagrams of a figure, or the rows of a table (one panel with a single x)."""

    name: str
    title: str
    panels: tuple[Panel, ...]

    def only(self, points: Collection[tuple[str, float]]) -> Study:
        """The part with these (panel, x)."""
        xs = {panel.name: tuple(x for x in panel.xs if (panel.name, x) in points) for panel in self.panels}
        return replace(self, panels=tuple(replace(p, xs=xs[p.name]) for p in self.panels if xs[p.name]))


@dataclass(frozen=True, order=True)
class Unit:
    """What a worker does at once: all curves of a panel at one x, one seed and one frame."""

    panel: str
    x: float
    seed: int
    scene: str
    frame: str
