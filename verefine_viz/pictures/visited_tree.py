"""The search tree that the records of PHYSIM-MCTS describe, with the visits and costs that page and recordings show.

They draw it differently: the page folds it into layers of boxes, a recording shows every node in a graph view.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from verefine_viz.core.records import TreeStep

ROOT = -1
"""``instance_id`` of the root, which places nothing."""


@dataclass(frozen=True)
class DrawnNode:
    """One node: an object placed from one of its hypotheses, after the objects of the nodes above."""

    number: int
    """0 is the root, in which nothing is placed."""
    parent: int
    depth: int
    """Number of objects placed, this one included."""
    instance_id: int
    arm: int
    lcp: float
    iteration: int
    """Iteration of the run, in which it was added; 0 for the root."""
    visits: int = 0
    cost_px: float = 0.0
    """Sum over the visits."""
    children: tuple[int, ...] = ()
    """In the order in which they were added."""

    @property
    def mean_px(self) -> float:
        """Cost per visit."""
        return self.cost_px / self.visits if self.visits else float("inf")


@dataclass(frozen=True)
class Tree:
    """The tree of one cluster."""

    cluster: int
    """From 0."""
    nodes: tuple[DrawnNode, ...]
    """By number."""
    branch: tuple[int, ...]
    """Nodes from the root to the one visited last."""
    incumbent: tuple[int, ...]
    """Nodes from the root to the one from which the best scene was completed by a roll-out."""
    incumbent_px: float
    incumbent_iteration: int
    costs: tuple[tuple[int, float, float], ...]
    """(iteration, its cost, cost of the incumbent), one per iteration."""
    choices: tuple[str, ...]
    """Why each node of the branch after the root was chosen."""

    def below(self, number: int = 0) -> Iterator[DrawnNode]:
        """The nodes below a node, parents first, the most visited sibling first and the cheaper one on ties."""
        children = (self.nodes[k] for k in self.nodes[number].children)
        for child in sorted(children, key=lambda n: (-n.visits, n.mean_px, n.number)):
            yield child
            yield from self.below(child.number)


class GrowingTree:
    """The tree of one cluster, built step by step; without any step it has the root alone."""

    def __init__(self, cluster: int) -> None:
        self._cluster = cluster
        self._nodes = [DrawnNode(0, -1, 0, ROOT, -1, 0.0, 0)]
        self._incumbent: tuple[tuple[int, ...], float, int] = ((0,), float("inf"), 0)
        self._costs: list[tuple[int, float, float]] = []
        self._branch: tuple[int, ...] = (0,)
        self._choices: tuple[str, ...] = ()

    def add(self, index: int, step: TreeStep) -> None:
        """Add the next step, made in iteration ``index``."""
        nodes, added = self._nodes, step.node
        if added is not None:
            parent = nodes[added.parent]
            nodes[added.parent] = replace(parent, children=(*parent.children, added.node))
            depth = parent.depth + 1
            nodes.append(DrawnNode(added.node, added.parent, depth, added.instance_id, added.arm, added.lcp, index))
        for number in step.branch:
            node = nodes[number]
            nodes[number] = replace(node, visits=node.visits + 1, cost_px=node.cost_px + step.cost_px)
        if step.incumbent_cost_px < self._incumbent[1]:
            self._incumbent = step.branch, step.incumbent_cost_px, index
        self._costs.append((index, step.cost_px, step.incumbent_cost_px))
        self._branch, self._choices = step.branch, step.choices

    @property
    def tree(self) -> Tree:
        """The tree as it is now."""
        nodes, costs = tuple(self._nodes), tuple(self._costs)
        return Tree(self._cluster, nodes, self._branch, *self._incumbent, costs, self._choices)
