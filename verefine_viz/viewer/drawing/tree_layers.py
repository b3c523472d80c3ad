"""A search tree on the page: all of it as layers of boxes, and as an indented list of what is worth reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from verefine_viz.core.palette import RGB, lookup_table
from verefine_viz.pictures.visited_tree import Node, Tree
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.drawing.markup import Row, carries, swatch, table, text

# Which nodes of a big search tree are drawn, and what the others are folded into. The way to the best scene and the
# branch of this iteration are always drawn, then what was visited most, as long as every box stays wide enough to be
# read and clicked. Of the rest one box per parent remains.


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
        """Its lower end, from left to right."""
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


WIDTH, LAYER, GAP, STRIP = 340, 26, 2, 8
NARROWEST, WITH_VISITS_PX = 30, 56
"""Width of a box that "+97" fits into, and of one that its visits fit into as well [px]."""
CHEAP, DEAR = (53, 183, 121), (68, 40, 90)
"""Ends of the colours of cost per visit: cheap is good."""
BRANCH_COLOR: RGB = (255, 255, 255)
INCUMBENT_COLOR: RGB = (240, 200, 60)
MOST_ROWS = 40


def layers_svg(tree: Tree, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> str:
    """A layer per object; a box is green where its cost per visit is low, and wider where it was visited often.

    What was visited little is folded into one box per parent, which says how many nodes it holds. The branch of this
    iteration is outlined in white, the way to the incumbent in gold. A click goes to the iteration in which a node was
    added.
    """
    drawn = boxes(tree, WIDTH, NARROWEST)
    low, high = _range(tree)
    parts, outlines = [], []
    for box in drawn:
        y = (box.depth - 1) * (LAYER + GAP)
        if isinstance(box.what, Fold):
            parts.append(_fold(box, y, labels, _color(box.what.best.mean_px, low, high)))
            continue
        parts.append(_node(box, box.what, y, labels, _color(box.what.mean_px, low, high)))
        for way, color in ((tree.incumbent, INCUMBENT_COLOR), (tree.branch, BRANCH_COLOR)):
            if box.what.number in way:
                inset = 3 if color == INCUMBENT_COLOR and box.what.number in tree.branch else 1
                outlines.append(
                    f'<rect x="{box.x + inset:.1f}" y="{y + inset}" width="{max(box.width - 1 - 2 * inset, 1):.1f}" '
                    f'height="{LAYER - 2 * inset}" fill="none" stroke="rgb{color}" stroke-width="2" '
                    'pointer-events="none"/>'
                )
    n_layers = max(box.depth for box in drawn)
    height = n_layers * (LAYER + GAP)
    return (
        f'<svg viewBox="{-STRIP} 0 {WIDTH + STRIP} {height}" width="100%" style="cursor:pointer;margin-bottom:4px">'
        f"{''.join(_strips(tree, n_layers, labels, colors))}{''.join(parts)}{''.join(outlines)}</svg>"
    )


def _node(box: Box, node: Node, y: float, labels: Mapping[int, str], color: str) -> str:
    title = f"{_name(node, labels)}: {_numbers(node)}; added in iteration {node.iteration}"
    caption = f"h{node.arm + 1}" + (f" · {node.visits}×" if box.width >= WITH_VISITS_PX else "")
    return _box(box, y, c.Seek(node.iteration), f'fill="{color}"', caption, title)


def _fold(box: Box, y: float, labels: Mapping[int, str], color: str) -> str:
    assert isinstance(box.what, Fold)
    best, n = box.what.best, len(box.what.nodes)
    title = (
        f"{n} nodes more, {_visits(box.what.visits)}; the cheapest of them: {_name(best, labels)}, {_numbers(best)}. "
        f"Click: iteration {best.iteration}, which tried it."
    )
    look = f'fill="{color}" fill-opacity="0.3" stroke="{color}" stroke-dasharray="3 2"'
    return _box(box, y, c.Seek(best.iteration), look, f"+{n}", title)


def _box(box: Box, y: float, command: c.Command, look: str, caption: str, title: str) -> str:
    return (
        f'<g {carries(command)}><rect x="{box.x:.1f}" y="{y}" width="{box.width - 1:.1f}" height="{LAYER}" {look}/>'
        f'<text x="{box.x + 3:.1f}" y="{y + 17}" font-size="11" fill="white">{caption}</text>'
        f"<title>{text(title)}</title></g>"
    )


def _strips(tree: Tree, n_layers: int, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> list[str]:
    """The colour of each layer's object, at its left."""
    objects = {node.depth: node.instance_id for node in tree.nodes[1:] if node.depth <= n_layers}
    return [
        f'<rect x="{-STRIP}" y="{(depth - 1) * (LAYER + GAP)}" width="{STRIP - 2}" height="{LAYER}" '
        f'fill="rgb{colors.get(instance_id, (128, 128, 128))}"><title>{text(labels.get(instance_id, "object"))}'
        "</title></rect>"
        for depth, instance_id in objects.items()
    ]


def nodes_table(tree: Tree, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> str:
    """The tree as an indented list: nodes with children, the branch of this iteration, and the way to the incumbent.

    Of a tree that is too big for it, what was tried once and led nowhere is counted in one line.
    """
    rows: list[Row] = []
    folded: list[Node] = []
    fits = len(tree.nodes) - 1 <= MOST_ROWS
    for node in tree.below():
        on_a_way = node.number in tree.branch or node.number in tree.incumbent
        if not (on_a_way or fits) and (not _worth_reading(node) or len(rows) >= MOST_ROWS):
            folded.append(node)
            continue
        marks = ("★" if node.number in tree.incumbent else "") + ("▶" if node.number in tree.branch else "")
        indent = 12 * (node.depth - 1)
        cells = [
            f'<span style="padding-left:{indent}px">{swatch(colors.get(node.instance_id, (128, 128, 128)))}'
            f"{text(labels.get(node.instance_id, 'object'))} h{node.arm + 1} {marks}</span>",
            f"{node.visits}",
            f"{node.mean_px:,.0f}",
            f"{node.lcp:.2f}",
        ]
        rows.append(Row(cells, c.Seek(node.iteration), marked=node.number == tree.branch[-1]))
    head = [
        ("node", "object and hypothesis; ▶ = branch of this iteration, ★ = way to the incumbent; click to go there"),
        ("visits", "how often a branch went through it"),
        ("px/visit", "mean cost of the complete scenes below it: pixels that are not explained"),
        ("LCP", "share of the model's points that the segment explains at the hypothesis: what was tried first"),
    ]
    return table(head, rows) + _not_listed(folded)


def _not_listed(nodes: Sequence[Node]) -> str:
    """A line that counts them; empty where there are none."""
    if not nodes:
        return ""
    once = "" if any(map(_worth_reading, nodes)) else ", visited once and without any below,"
    what = f"{len(nodes)} more nodes{once} are" if len(nodes) > 1 else f"1 more node{once} is"
    return f'<p class="dim">{what} not listed.</p>'


def _worth_reading(node: Node) -> bool:
    return bool(node.children) or node.visits > 1


def _range(tree: Tree) -> tuple[float, float]:
    means = [n.mean_px for n in tree.nodes[1:]]
    return min(means), max(means)


def _color(cost_px: float, low: float, high: float) -> str:
    share = (cost_px - low) / (high - low) if high > low else 0.0
    r, g, b = lookup_table((CHEAP, DEAR))[int(np.clip(round(share * 255), 0, 255))]
    return f"rgb({r},{g},{b})"


def _name(node: Node, labels: Mapping[int, str]) -> str:
    return f"{labels.get(node.instance_id, 'object')}, hypothesis {node.arm + 1}"


def _numbers(node: Node) -> str:
    return f"{_visits(node.visits)}, {node.mean_px:,.0f} px per visit, LCP {node.lcp:.2f}"


def _visits(n: int) -> str:
    return f"{n} visit{'s' if n != 1 else ''}"


def tree_html(tree: Tree, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> str:
    """Picture, choices and list."""
    way = [labels.get(tree.nodes[k].instance_id, "object") for k in tree.branch[1:]]
    chosen = "".join(f"<p>{text(n)}: {text(choice)}</p>" for n, choice in zip(way, tree.choices, strict=False))
    legend = (
        '<p class="dim" style="font-size:11px">A layer per object (its colour at the left): h3 · 7× = hypothesis 3, '
        f"visited 7 times; +97 = so many more, folded. {swatch(CHEAP)}cheap {swatch(DEAR)}dear per visit, "
        f"{swatch(BRANCH_COLOR)}this branch, {swatch(INCUMBENT_COLOR)}way to the cheapest scene.</p>"
    )
    tip = "a node is taken where its cost per visit minus its bonus for few visits is lowest; untried ones come first"
    why = f'<p title="{tip}"><b>Why this branch</b>, node by node (cost per visit − bonus)</p>' if chosen else ""
    return f"{layers_svg(tree, labels, colors)}{legend}{why}{chosen}{nodes_table(tree, labels, colors)}"
