"""The search tree that the records of PHYSIM-MCTS add up to, at any moment of the run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from verefine_viz.core.records import Iteration


@dataclass(frozen=True)
class Node:
    """One node: an object placed from one of its hypotheses, after those of the nodes above."""

    number: int
    """0 is the root, in which nothing is placed."""
    parent: int
    depth: int
    """Objects placed, this one included."""
    instance_id: int
    arm: int
    lcp: float
    visits: int
    cost_px: float
    """Sum over the visits."""
    iteration: int
    """Of the run, in which it was added; 0 for the root."""
    children: tuple[int, ...]
    """As they came about."""

    @property
    def mean_px(self) -> float:
        """Cost per visit."""
        return self.cost_px / self.visits if self.visits else float("inf")


@dataclass(frozen=True)
class Tree:
    """The tree of one cluster."""

    cluster: int
    """From 0."""
    nodes: tuple[Node, ...]
    """By number."""
    branch: tuple[int, ...]
    """Nodes from the root to the one visited last."""
    incumbent: tuple[int, ...]
    """Nodes from the root to where the best complete scene was found; what lies below came from its roll-out."""
    incumbent_px: float
    incumbent_iteration: int
    costs: tuple[tuple[int, float, float], ...]
    """(iteration, its cost, cost of the incumbent), one per iteration."""
    choices: tuple[str, ...]
    """Why each node of the branch after the root was chosen."""
    rollout: tuple[tuple[int, int], ...]
    """(instance_id, arm) of what completed the scene."""

    def below(self, number: int = 0) -> Iterator[Node]:
        """The nodes below one, parents first, the most visited sibling first and the cheaper one on ties."""
        children = (self.nodes[k] for k in self.nodes[number].children)
        for child in sorted(children, key=lambda n: (-n.visits, n.mean_px, n.number)):
            yield child
            yield from self.below(child.number)


@dataclass
class _Growing:
    parent: int
    depth: int
    instance_id: int
    arm: int
    lcp: float
    iteration: int
    visits: int = 0
    cost_px: float = 0.0
    children: list[int] = field(default_factory=list)


def tree_of(iterations: Sequence[Iteration], cluster: int | None = None) -> Tree | None:
    """The tree after these iterations; None where none of them searched.

    Args:
        iterations: of a run, in order; others than those of a tree search are passed over.
        cluster: whose tree; None = the one that was searched last.
    """
    steps = [(i.index, i.tree) for i in iterations if i.tree is not None]
    if cluster is None and steps:
        cluster = steps[-1][1].cluster
    steps = [(index, step) for index, step in steps if step.cluster == cluster]
    if not steps or cluster is None:
        return None
    growing: dict[int, _Growing] = {0: _Growing(-1, 0, -1, -1, 0.0, 0)}
    incumbent, found, lowest = (0,), 0, float("inf")
    costs = []
    for index, step in steps:
        node = step.node
        if node is not None:
            parent = growing[node.parent]
            parent.children.append(node.node)
            growing[node.node] = _Growing(node.parent, parent.depth + 1, node.instance_id, node.arm, node.lcp, index)
        for number in step.branch:
            growing[number].visits += 1
            growing[number].cost_px += step.cost_px
        if step.incumbent_cost_px < lowest:
            incumbent, found, lowest = step.branch, index, step.incumbent_cost_px
        costs.append((index, step.cost_px, step.incumbent_cost_px))
    nodes = tuple(
        Node(
            number, g.parent, g.depth, g.instance_id, g.arm, g.lcp, g.visits, g.cost_px, g.iteration, tuple(g.children)
        )
        for number, g in sorted(growing.items())
    )
    last = steps[-1][1]
    rollout = tuple(zip((p.instance_id for p in last.rollout), last.rollout_arms, strict=True))
    return Tree(cluster, nodes, last.branch, incumbent, lowest, found, tuple(costs), last.choices, rollout)
