"""Which nodes of a big search tree are drawn, and what the others are folded into.

The way to the best scene and the branch of this iteration are always drawn, then what was visited most, as long as
every box stays wide enough to be read and clicked. Of the rest one box per parent remains.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from verefine_viz.viewer.tree import Node, Tree


@dataclass(frozen=True)
class Fold:
    """Nodes below one parent that are not drawn."""

    parent: int
    roots: tuple[Node, ...]
    """Children of the parent."""
    nodes: tuple[Node, ...]
    """They and all that is below them."""

    @property
    def visits(self) -> int:
        """Of the children; what is below them is counted with them."""
        return sum(n.visits for n in self.roots)

    @property
    def best(self) -> Node:
        """The cheapest per visit."""
        return min(self.nodes, key=lambda n: (n.mean_px, n.number))


@dataclass(frozen=True)
class Drawn:
    """A node or a fold, with what is drawn below it."""

    what: Node | Fold
    below: tuple[Drawn, ...] = ()

    @property
    def leaves(self) -> tuple[Drawn, ...]:
        """What stands side by side at its lower end."""
        return tuple(leaf for child in self.below for leaf in child.leaves) or (self,)


@dataclass(frozen=True)
class Box:
    """A place in the picture."""

    x: float
    width: float
    depth: int
    """Layer, from 1."""
    what: Node | Fold


def boxes(tree: Tree, width: float, narrowest: float) -> tuple[Box, ...]:
    """The picture: a box per node that is drawn and per fold, none narrower than ``narrowest`` where that can be.

    Children stand below their parent and share its width; what is left over goes to what was visited often.
    """
    shown = shown_nodes(tree, int(width // narrowest))
    top = _drawn_below(tree, shown, tree.nodes[0])
    leaves = [leaf for drawn in top for leaf in drawn.leaves]
    least = min(narrowest, width / max(len(leaves), 1))
    spare = (width - least * len(leaves)) / max(sum(leaf.what.visits for leaf in leaves), 1)

    def placed(drawn: Drawn, x: float, depth: int) -> Iterator[Box]:
        yield Box(x, sum(least + spare * leaf.what.visits for leaf in drawn.leaves), depth, drawn.what)
        yield from row(drawn.below, x, depth + 1)

    def row(side_by_side: tuple[Drawn, ...], x: float, depth: int) -> Iterator[Box]:
        for drawn in side_by_side:
            own = tuple(placed(drawn, x, depth))
            yield from own
            x += own[0].width

    return tuple(row(top, 0.0, 1))


def shown_nodes(tree: Tree, most: int) -> frozenset[int]:
    """Numbers of the nodes to draw, so that at most ``most`` boxes stand side by side; the root is one of them.

    The two ways are drawn even if they need more.
    """
    shown = {0, *tree.branch, *tree.incumbent}
    free = most - sum(len(drawn.leaves) for drawn in _drawn_below(tree, frozenset(shown), tree.nodes[0]))
    while True:
        hidden = [[k for k in tree.nodes[number].children if k not in shown] for number in shown]
        # The last of some siblings takes the place of their fold; any other needs a place.
        near = [tree.nodes[k] for siblings in hidden for k in siblings if free > 0 or len(siblings) == 1]
        if not near:
            return frozenset(shown)
        chosen = min(near, key=_first_most_visited)
        shown.add(chosen.number)
        free -= not shown.issuperset(tree.nodes[chosen.parent].children)


def _drawn_below(tree: Tree, shown: frozenset[int], parent: Node) -> tuple[Drawn, ...]:
    children = sorted((tree.nodes[k] for k in parent.children), key=_first_most_visited)
    drawn = [Drawn(n, _drawn_below(tree, shown, n)) for n in children if n.number in shown]
    hidden = tuple(n for n in children if n.number not in shown)
    if hidden:
        below = tuple(node for root in hidden for node in (root, *tree.below(root.number)))
        drawn.append(Drawn(Fold(parent.number, hidden, below)))
    return tuple(drawn)


def _first_most_visited(node: Node) -> tuple[float, float, int]:
    return -node.visits, node.mean_px, node.number
