"""The Order panel: which objects depend on which, the order that follows, and changing it.

The picture has the objects from top to bottom in the order to solve them, and edges as arcs beside them. An arc of
what carries is solid, of what hides dashed, of what may touch dotted; an arrow points to what is carried or hidden.
Edges that are excluded because they run in a circle are red, cut ones faint.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import viser

from verefine_viz.core.palette import RGB
from verefine_viz.core.problem import DependencyGraph, Edge, EdgeKind
from verefine_viz.methods.registry import method_of
from verefine_viz.viewer.commands import CutDependency, Focus, MoveInOrder, ResetOrder
from verefine_viz.viewer.drawing.markup import carries, link, sentence, text, warning
from verefine_viz.viewer.handlers.open_handlers import moved
from verefine_viz.viewer.panels.widgets import Block
from verefine_viz.viewer.snapshot.scene_state import color_of, labels_of
from verefine_viz.viewer.snapshot.snapshot import Snapshot
from verefine_viz.viewer.text.display_names import abridged
from verefine_viz.viewer.text.empty_tabs import no_order

RULES = {
    "recommended": "The order follows from what touches, hides and carries what.",
    "published": "The order follows the authors' rule: masks that touch form a cluster, lower tops come first.",
    "given": "The order is given by the session.",
}


class OrderPanel:
    """Words, the graph, and the evidence with links to cut it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._block = Block(gui, "order")

    def show(self, snapshot: Snapshot) -> None:
        """The graph of the frame; it does not change during a run."""
        self._block.show(order_html(snapshot))


def order_html(snapshot: Snapshot) -> str:
    """The whole content of the panel."""
    graph, names = snapshot.problem.dependencies, labels_of(snapshot.problem)
    if graph is None or len(names) < 2:
        return sentence(no_order(snapshot))
    focus = None if snapshot.is_whole_scene else snapshot.target.instance.instance_id
    nodes = {
        i.instance_id: Node(names[i.instance_id], color_of(k), i.instance_id == focus)
        for k, i in enumerate(snapshot.problem.instances)
    }
    method, words, tip = method_of(snapshot.session.method.name), RULES[graph.source], ""
    if not method.knows_others:
        words = f"{method.label} solves each object alone; VF_b, VF_d and PHYSIM-MCTS follow this order."
        tip = f"Solved in the order of the frame: {', '.join(names.values())}"
    back = ""
    if graph.source == "given":
        back = " · " + link("back to the rule's order", ResetOrder(), "forget the given order; cuts stay")
    hint = '<span class="dim" title="▴ earlier, ▾ later">Moving and cutting restart the run.</span>'
    pairs: dict[frozenset[int], list[Edge]] = {}
    for edge in _most_telling_first(graph.edges):
        pairs.setdefault(frozenset((edge.first, edge.second)), []).append(edge)
    return "".join(
        (
            f'<p class="say" title="{text(tip)}">{text(words)}</p>',
            picture(graph, nodes),
            f'<p style="margin-top:4px">{hint}{back}</p>',
            *(_pair(edges, names) for edges in pairs.values()),
            *(warning(f"{note[:1].upper()}{note[1:]}.") for note in graph.notes),
        )
    )


def _most_telling_first(edges: Iterable[Edge]) -> list[Edge]:
    return sorted(edges, key=lambda e: (TELLING[e.kind], e.first, e.second))


def _pair(edges: list[Edge], names: Mapping[int, str]) -> str:
    """What is seen between two objects, and a link to cut or restore it."""
    first, second = edges[0].first, edges[0].second
    is_cut = edges[0].state == "cut"
    if is_cut:
        act = link("restore", CutDependency(first, second, False), "let it count again (restarts the run)")
    else:
        act = link("cut", CutDependency(first, second), "what is seen between the two is to count no more")
    evidence = ". ".join(text(full(e, names[e.first], names[e.second])) for e in edges)
    return f'<p class="{"dim" if is_cut else ""}" style="margin-bottom:4px;font-size:12px">{evidence}. {act}</p>'


# The picture.

WIDTH_PX = 352
ROW_PX, GAP_PX, MARGIN_PX = 25, 9, 4
SWATCH_X, INDENT_PX, ARC_X, LABEL_X, LABEL_PX = 22, 11, 184, 252, 13
MOVERS_PX, CHARACTER_PX, BOLD_PX = 36, 7.3, 8.3
VERBS: Mapping[EdgeKind, str] = {"support": "carries", "occlusion": "hides", "contact": "may touch"}
DASHES: Mapping[EdgeKind, str] = {"support": "none", "occlusion": "6 4", "contact": "1.5 4"}
TELLING: Mapping[EdgeKind, int] = {"support": 0, "occlusion": 1, "contact": 2}
RED = "rgb(235,80,75)"


@dataclass(frozen=True)
class Node:
    """An object in the picture."""

    label: str
    color: RGB
    in_focus: bool = False


def picture(graph: DependencyGraph, nodes: Mapping[int, Node]) -> str:
    """The graph as SVG; ``nodes`` by instance_id, all of the graph's."""
    rows = _rows(graph)
    height = max(rows.values(), default=0) + ROW_PX / 2 + MARGIN_PX
    parts = _clusters(graph, rows)
    parts += [_object(graph, i, nodes[i], rows[i]) for i in graph.order]
    arcs, labels_end = _arcs(graph, nodes, rows)
    height = max(height, labels_end)
    return f'<svg viewBox="0 0 {WIDTH_PX} {height:.0f}" style="display:block;width:100%">{"".join(parts + arcs)}</svg>'


def shown_edges(graph: DependencyGraph) -> list[Edge]:
    """Those that are drawn, the most telling first: a contact says nothing new beside a support."""
    carrying = {frozenset((e.first, e.second)) for e in graph.edges if e.kind == "support"}
    return _most_telling_first(
        e for e in graph.edges if e.kind != "contact" or frozenset((e.first, e.second)) not in carrying
    )


def short(edge: Edge) -> str:
    """An edge in two words: "carries 64%", "hides 38 mm"."""
    number = re.match(r"[\d.]+ ?(%|mm)", edge.evidence)
    words = f"{VERBS[edge.kind]} {number.group() if number else ''}".strip()
    return words + {"used": "", "ambiguous": " ⟲", "cut": " ✂"}[edge.state]


def full(edge: Edge, first: str, second: str) -> str:
    """As in: cereal carries can: 64% of its footprint, 2 mm above."""
    joined = "and" if edge.kind == "contact" else VERBS[edge.kind]
    ending = " may touch" if edge.kind == "contact" else ""
    excluded = {"used": "", "ambiguous": "; in a circle, excluded from the order", "cut": "; cut"}[edge.state]
    return f"{first} {joined} {second}{ending}: {edge.evidence}{excluded}"


def _rows(graph: DependencyGraph) -> dict[int, float]:
    """The middle of each object's row [px]."""
    rows, y = {}, MARGIN_PX + ROW_PX / 2
    for cluster in graph.clusters:
        for instance_id in cluster:
            rows[instance_id] = y
            y += ROW_PX
        y += GAP_PX
    return rows


def _clusters(graph: DependencyGraph, rows: Mapping[int, float]) -> list[str]:
    """A box behind the objects of each cluster."""
    boxes = []
    for k, cluster in enumerate(graph.clusters, start=1):
        top, height = rows[cluster[0]] - ROW_PX / 2, ROW_PX * len(cluster)
        boxes.append(
            f'<rect x="0.5" y="{top:.1f}" width="{ARC_X - 7}" height="{height:.1f}" rx="5" fill="currentColor" '
            f'fill-opacity="0.07" stroke="currentColor" stroke-opacity="0.25"><title>cluster {k} of '
            f"{len(graph.clusters)}: what may interact is solved together</title></rect>"
        )
    return boxes


def _object(graph: DependencyGraph, instance_id: int, node: Node, y: float) -> str:
    """Place, colour, name, and what moves it."""
    place = graph.order.index(instance_id) + 1
    x = SWATCH_X + INDENT_PX * min(_level(graph, instance_id), 3)
    n_characters = int((ARC_X - MOVERS_PX - x - 15) / (BOLD_PX if node.in_focus else CHARACTER_PX))
    name = abridged(node.label, n_characters)
    weight = ' font-weight="700"' if node.in_focus else ""
    return (
        f'<text x="6" y="{y + 4:.1f}" font-size="11" fill="currentColor" opacity="0.65">{place}</text>'
        f'<g {carries(Focus(instance_id))} style="cursor:pointer"><rect x="{x}" y="{y - 5:.1f}" width="10" '
        f'height="10" rx="2" fill="rgb{node.color}"/><text x="{x + 15}" y="{y + 4:.1f}" font-size="12" '
        f'fill="currentColor"{weight}>{text(name)}</text><title>{text(node.label)}: click to show it</title></g>'
        + _mover(graph, instance_id, -1, y)
        + _mover(graph, instance_id, 1, y)
    )


def _mover(graph: DependencyGraph, instance_id: int, by: int, y: float) -> str:
    """A small triangle that solves the object earlier or later."""
    if moved(graph.clusters, instance_id, by) is None:
        return ""
    x = ARC_X - 33 if by < 0 else ARC_X - 20
    points = f"{x},{y - 3.5 * by:.1f} {x + 9},{y - 3.5 * by:.1f} {x + 4.5},{y + 3.5 * by:.1f}"
    title = f"solve it {'earlier' if by < 0 else 'later'} (restarts the run)"
    return (
        f'<g {carries(MoveInOrder(instance_id, by))} style="cursor:pointer"><rect x="{x - 2}" y="{y - 8:.1f}" '
        f'width="13" height="16" fill="transparent"/><polygon points="{points}" fill="currentColor" opacity="0.7"/>'
        f"<title>{title}</title></g>"
    )


def _level(graph: DependencyGraph, instance_id: int) -> int:
    """How many objects carry each other below it, of those that come before it in its support list."""
    below = {e.second: e.first for e in graph.edges if e.kind == "support" and e.state == "used"}
    chain = next(chain for chain in graph.support_lists if instance_id in chain)
    level = 0
    while below.get(instance_id) in chain[: chain.index(instance_id)]:
        instance_id, level = below[instance_id], level + 1
    return level


def _arcs(graph: DependencyGraph, nodes: Mapping[int, Node], rows: Mapping[int, float]) -> tuple[list[str], float]:
    """Arcs with their labels, and how far down the labels reach."""
    parts, labels = [], []
    for edge in shown_edges(graph):
        y_first, y_second = rows[edge.first], rows[edge.second]
        down = 1 if y_second > y_first else -1
        # Ends lean towards each other, hiding a little further in than carrying, so that arcs of one pair lie apart.
        inset = 4.5 - 4 * TELLING[edge.kind]
        y_first, y_second = y_first + down * inset, y_second - down * inset
        bulge = min(20 + 0.45 * abs(y_second - y_first) + 9 * TELLING[edge.kind], LABEL_X - ARC_X - 4) / 0.75
        apex = ARC_X + 0.75 * bulge
        title = text(full(edge, nodes[edge.first].label, nodes[edge.second].label))
        path = f"M{ARC_X},{y_first:.1f} C{ARC_X + bulge:.1f},{y_first:.1f} {ARC_X + bulge:.1f},{y_second:.1f} "
        path += f"{ARC_X},{y_second:.1f}"
        stroke = RED if edge.state == "ambiguous" else "currentColor"
        opacity = 0.25 if edge.state == "cut" else 0.9 if edge.kind == "support" else 0.6
        width = 2.2 if edge.kind == "support" else 1.6
        head = ""
        if edge.kind != "contact":
            points = f"{ARC_X - 2},{y_second:.1f} {ARC_X + 6},{y_second - 3.6:.1f} {ARC_X + 6},{y_second + 3.6:.1f}"
            head = f'<polygon points="{points}" fill="{stroke}"/>'
        parts.append(
            f'<g opacity="{opacity}"><path d="{path}" fill="none" stroke="{stroke}" stroke-width="{width}" '
            f'stroke-dasharray="{DASHES[edge.kind]}"/>{head}<title>{title}</title></g>'
        )
        labels.append(((y_first + y_second) / 2, apex, short(edge), stroke, opacity, title))
    end = MARGIN_PX + LABEL_PX / 2
    for y_arc, apex, label, color, opacity, title in sorted(labels, key=lambda label: label[:3]):
        y = max(y_arc, end)
        end = y + LABEL_PX
        parts.append(
            f'<g><line x1="{apex:.1f}" y1="{y_arc:.1f}" x2="{LABEL_X - 2}" y2="{y:.1f}" stroke="{color}" '
            f'opacity="0.3"/><text x="{LABEL_X}" y="{y + 3.5:.1f}" font-size="11" fill="{color}" '
            f'opacity="{max(opacity, 0.45)}">{text(label)}</text><title>{title}</title></g>'
        )
    return parts, end
