"""A search tree on the page: all of it as layers of boxes, and as an indented list of what is worth reading."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from verefine_viz.core.colormaps import lookup_table
from verefine_viz.core.palette import RGB
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.markup import Row, carries, swatch, table, text
from verefine_viz.viewer.tree import Node, Tree

WIDTH, LAYER, GAP, STRIP = 340, 26, 2, 8
CHEAP, DEAR = (53, 183, 121), (68, 40, 90)
"""Ends of the colours of cost per visit: cheap is good."""
BRANCH_COLOR: RGB = (255, 255, 255)
INCUMBENT_COLOR: RGB = (240, 200, 60)
MOST_ROWS = 40


def layers_svg(tree: Tree, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> str:
    """A layer per object; a box is as wide as its visits and as green as its cost per visit is low.

    The branch of this iteration is outlined in white, the way to the incumbent in gold. A click goes to the iteration
    in which a node was added.
    """
    depth = max(n.depth for n in tree.nodes)
    places = _places(tree)
    low, high = _range(tree)
    boxes, outlines = [], []
    for node in tree.nodes[1:]:
        x, width = places[node.number]
        y = (node.depth - 1) * (LAYER + GAP)
        title = f"{_name(node, labels)}: {_numbers(node)}; added in iteration {node.iteration}"
        caption = f'<text x="{x + 3:.1f}" y="{y + 17}" font-size="11" fill="white">h{node.arm + 1}</text>'
        boxes.append(
            f'<g {carries(c.Seek(node.iteration))}><rect x="{x:.1f}" y="{y}" width="{max(width - 1, 0.8):.1f}" '
            f'height="{LAYER}" fill="{_color(node.mean_px, low, high)}"/>{caption if width > 22 else ""}'
            f"<title>{text(title)}</title></g>"
        )
        for way, color in ((tree.incumbent, INCUMBENT_COLOR), (tree.branch, BRANCH_COLOR)):
            if node.number in way:
                inset = 3 if color == INCUMBENT_COLOR and node.number in tree.branch else 1
                outlines.append(
                    f'<rect x="{x + inset:.1f}" y="{y + inset}" width="{max(width - 1 - 2 * inset, 1):.1f}" '
                    f'height="{LAYER - 2 * inset}" fill="none" stroke="rgb{color}" stroke-width="2" '
                    'pointer-events="none"/>'
                )
    height = depth * (LAYER + GAP)
    return (
        f'<svg viewBox="{-STRIP} 0 {WIDTH + STRIP} {height}" width="100%" style="cursor:pointer;margin-bottom:4px">'
        f"{''.join(_strips(tree, labels, colors))}{''.join(boxes)}{''.join(outlines)}</svg>"
    )


def _strips(tree: Tree, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> list[str]:
    """The colour of each layer's object, at its left."""
    objects = {node.depth: node.instance_id for node in tree.nodes[1:]}
    return [
        f'<rect x="{-STRIP}" y="{(depth - 1) * (LAYER + GAP)}" width="{STRIP - 2}" height="{LAYER}" '
        f'fill="rgb{colors.get(instance_id, (128, 128, 128))}"><title>{text(labels.get(instance_id, "object"))}'
        "</title></rect>"
        for depth, instance_id in objects.items()
    ]


def nodes_table(tree: Tree, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> str:
    """The tree as an indented list: nodes with children, the branch of this iteration, and the way to the incumbent.

    Siblings that were tried once and led nowhere are counted in one line.
    """
    rows: list[Row] = []
    folded = 0
    for node in tree.below():
        on_a_way = node.number in tree.branch or node.number in tree.incumbent
        if not on_a_way and (not _worth_reading(node) or len(rows) >= MOST_ROWS):
            folded += 1
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
    more = f'<p class="dim">{folded} more nodes were tried once; they are in the picture above.</p>' if folded else ""
    return table(head, rows) + more


def _worth_reading(node: Node) -> bool:
    return bool(node.children) or node.visits > 1


def _places(tree: Tree) -> dict[int, tuple[float, float]]:
    """(x, width) by number: children share their parent's width by their visits."""
    places = {0: (0.0, float(WIDTH))}
    for node in [tree.nodes[0], *tree.below()]:
        x, width = places[node.number]
        total = sum(tree.nodes[k].visits for k in node.children)
        # Visits that ended in the node itself leave a gap on the right.
        share = width / max(total, node.visits, 1)
        for k in sorted(node.children, key=lambda k: (-tree.nodes[k].visits, tree.nodes[k].mean_px, k)):
            places[k] = (x, share * tree.nodes[k].visits)
            x += places[k][1]
    return places


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
    visits = f"{node.visits} visit{'s' if node.visits != 1 else ''}"
    return f"{visits}, {node.mean_px:,.0f} px per visit, LCP {node.lcp:.2f}"


def tree_html(tree: Tree, labels: Mapping[int, str], colors: Mapping[int, RGB]) -> str:
    """Picture, choices and list."""
    way = [labels.get(tree.nodes[k].instance_id, "object") for k in tree.branch[1:]]
    chosen = "".join(f"<p>{text(n)}: {text(choice)}</p>" for n, choice in zip(way, tree.choices, strict=False))
    legend = (
        '<p class="dim" style="font-size:11px">A layer per object (its colour at the left), wide = visited often, '
        f"{swatch(CHEAP)}cheap {swatch(DEAR)}dear per visit, {swatch(BRANCH_COLOR)}this branch, "
        f"{swatch(INCUMBENT_COLOR)}way to the incumbent.</p>"
    )
    return f"{layers_svg(tree, labels, colors)}{legend}{chosen}{nodes_table(tree, labels, colors)}"
