"""What a recording has to show: what its views depend on."""

from __future__ import annotations

from dataclasses import dataclass

from verefine_viz.methods.registry import method_of
from verefine_viz.recording.layout import Layout

"""Methods whose iterations do not say how a bandit chose the hypothesis."""
LEGEND_ARMS = 12
"""With more hypotheses a legend would hide the curves."""


@dataclass(frozen=True)
class Shown:
    """What there is to be shown; recordings that agree in it share their views."""

    branches: tuple[str, ...]
    worked_on: tuple[str, ...]
    """Of them, those that have hypotheses."""
    has_truth: bool
    has_maps: bool
    has_graph: bool
    has_passes: bool
    has_tree: bool
    has_choice: bool
    has_legend: bool

    @property
    def is_scene(self) -> bool:
        """Whether there is more than one object."""
        return len(self.branches) > 1


def shown(layout: Layout, has_maps: bool) -> Shown:
    """What a recording of that layout has to show."""
    branches = layout.branches
    return Shown(
        branches=tuple(b.name for b in branches),
        worked_on=tuple(b.name for b in branches if b.n_arms),
        has_truth=any(b.has_truth for b in branches),
        has_maps=has_maps,
        has_graph=layout.has_graph and layout.is_scene,
        has_passes=layout.has_passes,
        has_tree=layout.has_tree,
        has_choice=method_of(layout.method).chooses,
        has_legend=all(b.n_arms <= LEGEND_ARMS for b in branches),
    )
