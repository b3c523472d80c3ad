"""What a study is: panels of curves, what the paper claims about them, and the units of work they make."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from verefine_viz.batch.runs import file_stem
from verefine_viz.core.problem import Problem

Settings = Mapping[str, Mapping[str, Any]]
"""Changed fields of a session by section."""
Prepare = Callable[[Problem, float, int], Problem]
"""(frame, x, seed) → the frame as it is at this x."""


@dataclass(frozen=True)
class StudyCurve:
    """One method with its budget."""

    label: str
    settings: Settings | None
    """Changed sections ``method``, ``icp``, ``tricp``, ``mcts``, ``physics``, ``score``; None: the first initial pose
    is the answer, unrefined."""
    inner: int = 1
    """Weight of a refiner call: its inner iterations, where the paper counts these."""
    most_calls: int | None = None
    """Refiner calls per object, roll-outs included, after which a tree search ends; None: its own budget."""


Metric = Literal["ar", "ar_vsd", "ar_mssd", "ar_mspd"]


@dataclass(frozen=True)
class Claim:
    """A claim of the paper about two curves: ``better`` lies above ``worse``, on average over the panel."""

    better: str
    worse: str
    metric: Metric = "ar"
    from_x: float = -math.inf
    to_x: float = math.inf
    """The range of x that it is about, both ends included."""
    reading: str = ""
    """The paper's sentence, where it says more than that."""
    than: str = ""
    """Another panel, in which ``better`` lies above ``worse`` by less at the same x; "" = none."""


@dataclass(frozen=True)
class Panel:
    """One diagram: every curve at every x."""

    name: str
    x_label: str
    xs: tuple[float, ...]
    curves: tuple[StudyCurve, ...]
    prepare: Prepare = field(repr=False)
    claims: tuple[Claim, ...] = ()
    budget: str = ""
    """The refiner and its number of calls, with the place in the paper."""
    is_grasped: bool = False
    """Whether every answer is tried with the simulated gripper."""
    may_lack: bool = False
    """Whether a curve whose refiner is unavailable, for example without weights, is left empty with the reason, instead
    of ending the study."""


@dataclass(frozen=True)
class Study:
    """All diagrams of a figure, or the rows of a table (one panel with a single x)."""

    name: str
    title: str
    panels: tuple[Panel, ...]
    own: tuple[str, ...] = ()
    """Settings, "section.field" or "section", that the study makes itself besides those of its curves."""

    @property
    def fixed(self) -> frozenset[str]:
        """Settings that the study makes itself, "section.field" or "section"."""
        settings = [curve.settings for panel in self.panels for curve in panel.curves if curve.settings is not None]
        of_curves = {f"{section}.{field}" for one in settings for section, fields in one.items() for field in fields}
        return frozenset(of_curves - {"method.refiner"} | set(self.own))

    def only(self, points: Collection[tuple[str, float]]) -> Study:
        """The part of the plan with these (panel, x)."""
        xs = {panel.name: tuple(x for x in panel.xs if (panel.name, x) in points) for panel in self.panels}
        return replace(self, panels=tuple(replace(p, xs=xs[p.name]) for p in self.panels if xs[p.name]))


@dataclass(frozen=True, order=True)
class Unit:
    """One job of a worker: all curves of a panel at one x, one seed and one frame."""

    panel: str
    x: float
    seed: int
    scene: str
    frame: str

    @property
    def stem(self) -> str:
        """The name of its files without their endings."""
        return f"{self.scene} {file_stem(self.frame)}, {self.panel}, {self.x:g}, seed {self.seed}"
