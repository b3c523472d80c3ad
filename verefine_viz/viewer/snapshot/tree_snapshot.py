"""The search tree that the records of PHYSIM-MCTS add up to, at any moment of the run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from verefine_viz.core.records import Iteration


@dataclass(eq=False)
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
    iteration: int
    """Of the run, in which it was added; 0 for the root."""
    visits: int = 0
    cost_px: float = 0.0
    """Sum over the visits."""
    children: list[int] = field(default_factory=list)
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
    nodes = {0: Node(0, -1, 0, -1, -1, 0.0, 0)}
    incumbent, incumbent_iteration, lowest = (0,), 0, float("inf")
    for index, step in steps:
        added = step.node
        if added is not None:
            parent = nodes[added.parent]
            parent.children.append(added.node)
            nodes[added.node] = Node(
                added.node, added.parent, parent.depth + 1, added.instance_id, added.arm, added.lcp, index
            )
        for number in step.branch:
            nodes[number].visits += 1
            nodes[number].cost_px += step.cost_px
        if step.incumbent_cost_px < lowest:
            incumbent, incumbent_iteration, lowest = step.branch, index, step.incumbent_cost_px
    last = steps[-1][1]
    return Tree(
        cluster=cluster,
        nodes=tuple(node for _, node in sorted(nodes.items())),
        branch=last.branch,
        incumbent=incumbent,
        incumbent_px=lowest,
        incumbent_iteration=incumbent_iteration,
        costs=tuple((index, step.cost_px, step.incumbent_cost_px) for index, step in steps),
        choices=last.choices,
        rollout=tuple(zip((p.instance_id for p in last.rollout), last.rollout_arms, strict=True)),
    )
