"""The search tree of PHYSIM-MCTS: which hypothesis of which object was placed after which, and at what cost.

Depth i places the i-th object of a cluster from one of its hypotheses. Trees are immutable and share the parts that did
not change. docs/methods.md 3.3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from verefine_viz.core.arrays import Float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis as the search sees it."""

    T_cam_obj: Float
    lcp: float
    """Share of the model's points that the segment explains at this pose, in [0, 1]; the largest is tried first."""
    n_edits: int = 0
    """How often its pose was edited; nodes placed before the last edit no longer count as its own."""


@dataclass(frozen=True, eq=False)
class Node:
    """An object placed after the objects of the nodes above it."""

    parent: int
    level: int
    """How many objects are placed; 0 is the root."""
    arm: int
    n_edits: int
    T_cam_obj: Float | None
    """Pose after placing; None for the root."""
    children: tuple[int, ...] = ()
    visits: int = 0
    cost_px: float = 0.0
    """Sum over the visits."""
    is_closed: bool = False
    """Whether nothing below it is left to expand."""

    @property
    def mean_px(self) -> float:
        """Mean cost of the scenes that were completed from here; visited nodes only."""
        return self.cost_px / self.visits


ROOT = Node(-1, 0, -1, 0, None)


@dataclass(frozen=True, eq=False)
class Selection:
    """The node to expand, and why."""

    branch: tuple[int, ...]
    """From the root to the node that gets a child."""
    arm: int
    """Whose candidate the child is placed from."""
    choices: tuple[str, ...]
    """Why each node after the root was chosen, in words, the new one last."""


@dataclass(frozen=True, eq=False)
class SearchTree:
    """The candidates of each object, and the nodes added so far."""

    pools: tuple[tuple[Candidate, ...], ...]
    """Per object, in the order of placing; none is empty."""
    nodes: tuple[Node, ...] = (ROOT,)
    """In the order in which they were added; node 0 is the root."""

    @property
    def n_expanded(self) -> int:
        return len(self.nodes) - 1

    @property
    def is_complete(self) -> bool:
        """Whether every combination of candidates was placed."""
        return self.nodes[0].is_closed

    def size(self, limit: int) -> int:
        """Number of nodes, root excluded, of the complete tree; at most ``limit``."""
        below = [0]  # a whole subtree below a node of the last level, of the one above, …
        for pool in reversed(self.pools):
            below.append(len(pool) * (1 + below[-1]))
        if below[-1] >= limit:
            return limit
        below.reverse()
        left = sum(len(self.untried(k)) * (1 + below[n.level + 1]) for k, n in enumerate(self.nodes) if not n.is_closed)
        return min(self.n_expanded + left, limit)

    def untried(self, node: int) -> list[int]:
        """Arms of the next object without a child below ``node``."""
        below = self.nodes[node]
        if below.level == len(self.pools):
            return []
        tried = {self.nodes[c].arm for c in below.children if self._is_of_its_candidate(self.nodes[c])}
        return [arm for arm in range(len(self.pools[below.level])) if arm not in tried]

    def favourite(self, level: int, among: list[int] | None = None) -> int:
        """The arm with the largest LCP of the object placed at ``level`` + 1; the first on ties."""
        pool = self.pools[level]
        return max(range(len(pool)) if among is None else among, key=lambda arm: (pool[arm].lcp, -arm))

    def select(self, exploration_px: float, edited: tuple[int, int] | None = None) -> Selection:
        """The next expansion of a tree that is not complete.

        A node with an untried candidate gets it, the largest LCP first; else the search goes on to the child with the
        lowest q/n − α·sqrt(2 ln N / n), q/n the mean cost, N and n the visits of the node and of the child. Children
        below which nothing is left to expand are passed over: the published search may visit their leaves again and
        again, which adds nothing.

        Args:
            exploration_px: α.
            edited: (level, arm) of a candidate that was edited and has not been placed since. It is placed before all
                others, below the nearest node that allows it.
        """
        branch, choices = [0], []
        while True:
            node = self.nodes[branch[-1]]
            if edited is not None and node.level == edited[0]:
                why = f"hypothesis {edited[1] + 1}: its pose was edited and is placed first"
                return Selection(tuple(branch), edited[1], (*choices, why))
            towards = [] if edited is None else self._deepest(node.children, edited[0])
            untried = self.untried(branch[-1])
            if untried and not towards:
                arm = self.favourite(node.level, untried)
                share = self.pools[node.level][arm].lcp
                left = "the last one untried" if len(untried) == 1 else f"largest overlap of {len(untried)} untried"
                return Selection(tuple(branch), arm, (*choices, f"hypothesis {arm + 1}: {100 * share:.0f} %, {left}"))
            children = towards or [c for c in node.children if not self.nodes[c].is_closed]
            bounds = [self._bound_px(node, c, exploration_px) for c in children]
            k = bounds.index(min(bounds))
            choices.append(self._reason(node, children, bounds, k))
            branch.append(children[k])

    def expanded(self, parent: int, arm: int, T_cam_obj: Float) -> SearchTree:
        """The tree with one more node, not visited yet."""
        above = self.nodes[parent]
        level = above.level + 1
        n_edits = self.pools[above.level][arm].n_edits
        node = Node(parent, level, arm, n_edits, T_cam_obj, is_closed=level == len(self.pools))
        grown = replace(self, nodes=(*self.nodes, node))
        return grown._with(parent, replace(above, children=(*above.children, len(self.nodes))))

    def backed_up(self, branch: tuple[int, ...], cost_px: float) -> SearchTree:
        """The tree with one more visit of each node of ``branch``, root first."""
        tree = self
        for k in reversed(branch):
            node = tree.nodes[k]
            visited = replace(node, visits=node.visits + 1, cost_px=node.cost_px + cost_px)
            tree = tree._with(k, replace(visited, is_closed=tree._closes(k)))
        return tree

    def with_candidate(self, level: int, arm: int, T_cam_obj: Float, lcp: float) -> SearchTree:
        """The tree with another pose for a candidate, which counts as untried again below every node."""
        pool = self.pools[level]
        edited = Candidate(T_cam_obj, lcp, pool[arm].n_edits + 1)
        pools = (*self.pools[:level], (*pool[:arm], edited, *pool[arm + 1 :]), *self.pools[level + 1 :])
        tree = replace(self, pools=pools)
        for k in reversed(range(len(self.nodes))):  # children come after their parents
            tree = tree._with(k, replace(tree.nodes[k], is_closed=tree._closes(k)))
        return tree

    def _deepest(self, children: tuple[int, ...], level: int) -> list[int]:
        """The children whose subtrees come nearest to ``level``."""
        depths = [self._depth(c, level) for c in children]
        return [c for c, depth in zip(children, depths, strict=True) if depth == max(depths)]

    def _depth(self, k: int, level: int) -> int:
        node = self.nodes[k]
        if node.level == level:
            return level
        return max((self._depth(c, level) for c in node.children), default=node.level)

    def _closes(self, k: int) -> bool:
        return not self.untried(k) and all(self.nodes[c].is_closed for c in self.nodes[k].children)

    def _is_of_its_candidate(self, node: Node) -> bool:
        return node.n_edits == self.pools[node.level - 1][node.arm].n_edits

    def _bound_px(self, node: Node, child: int, exploration_px: float) -> float:
        below = self.nodes[child]
        return below.mean_px - exploration_px * math.sqrt(2 * math.log(node.visits) / below.visits)

    def _reason(self, node: Node, children: list[int], bounds: list[float], k: int) -> str:
        def term(i: int) -> str:
            below = self.nodes[children[i]]
            return f"hypothesis {below.arm + 1}: {below.mean_px:.0f} − {below.mean_px - bounds[i]:.0f} px"

        rivals = [i for i in range(len(children)) if i != k]
        if not rivals:
            return f"{term(k)}, the only one with anything left to try"
        rival = min(rivals, key=lambda i: bounds[i])
        return f"{term(k)} {'=' if bounds[rival] == bounds[k] else '<'} {term(rival)}"

    def _with(self, k: int, node: Node) -> SearchTree:
        return replace(self, nodes=(*self.nodes[:k], node, *self.nodes[k + 1 :]))
