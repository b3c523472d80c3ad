"""Which objects depend on which, as a graph and in words."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import rerun as rr

from verefine_viz.core.dependency import DependencyGraph, Edge, EdgeKind
from verefine_viz.core.palette import OBJECT_COLORS
from verefine_viz.recording import chunks, entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.piece import Piece
from verefine_viz.recording.wording import plain

ROOM = 210.0
"""What a node with its label takes from left to right."""
VERBS: Mapping[EdgeKind, str] = {"contact": "may touch", "occlusion": "hides", "support": "carries"}


def dependency_chunks(graph: DependencyGraph, layout: Layout) -> Iterator[Piece]:
    """Nodes, edges and evidence; static."""
    names = {b.instance_id: b.name for b in layout.branches}
    colors = {b.instance_id: OBJECT_COLORS[k % len(OBJECT_COLORS)] for k, b in enumerate(layout.branches)}
    place = {i: n for n, i in enumerate(graph.order, start=1)}
    known = [i for i in graph.order if i in names]
    nodes = rr.GraphNodes(
        node_ids=[names[i] for i in known],
        labels=[f"{place[i]}. {names[i]} (cluster {graph.cluster_of(i) + 1})" for i in known],
        colors=[colors[i] for i in known],
        radii=[12.0] * len(known),
        positions=_places([[i for i in cluster if i in names] for cluster in graph.clusters]),
    )
    pairs = [
        pair
        for e in graph.edges
        if e.state == "used" and {e.first, e.second} <= set(known)
        for pair in _arrows(e, names)
    ]
    # Nodes and edges of different entities would be different graphs.
    yield chunks.fixed(f"{entities.GRAPH}/objects", nodes, rr.GraphEdges(pairs, graph_type="directed"))
    text = rr.TextDocument(_evidence(graph, names), media_type="text/markdown")
    yield chunks.fixed(entities.EVIDENCE, text)


def _places(clusters: Sequence[Sequence[int]]) -> list[tuple[float, float]]:
    """Clusters in rows and columns, each a ring in which the order goes round from the top: no edge of a cluster then
    runs through a third node.
    """
    across, down = (ROOM * max(2.0, math.sqrt(max(map(len, clusters), default=1))) * f for f in (1.0, 0.6))
    columns_ = math.ceil(math.sqrt(len(clusters)))
    places: list[tuple[float, float]] = []
    for k, cluster in enumerate(clusters):
        x, y, n = across * (k % columns_), down * (k // columns_), len(cluster)
        for angle in (2 * math.pi * j / n for j in range(n)):
            places.append((x + (0.35 * across * math.sin(angle) if n > 1 else 0.0), y - 0.35 * down * math.cos(angle)))
    return places


def _arrows(edge: Edge, names: Mapping[int, str]) -> list[tuple[str, str]]:
    """From the object that carries or hides to the other; both ways where they only may touch."""
    first, second = names[edge.first], names[edge.second]
    return [(first, second), (second, first)] if edge.kind == "contact" else [(first, second)]


def _evidence(graph: DependencyGraph, names: Mapping[int, str]) -> str:
    """The order and what it follows from, as markdown."""

    def name(instance_id: int) -> str:
        return plain(names.get(instance_id, f"#{instance_id}"))

    lines = [f"## Order ({graph.source})"]
    for k, cluster in enumerate(graph.clusters, start=1):
        lines.append(f"{k}. {' → '.join(name(i) for i in cluster)}")
    carried = [c for c in graph.support_lists if len(c) > 1]
    if carried:
        lines.append("\n## Stacks")
        lines += [f"- {name(base)} carries {', '.join(name(i) for i in rest)}" for base, *rest in carried]
    lines.append("\n## Evidence\n| | | | how one can tell | |\n|-|-|-|-|-|")
    for e in graph.edges:
        state = "" if e.state == "used" else f"**{e.state}**"
        lines[-1] += f"\n| {name(e.first)} | {VERBS[e.kind]} | {name(e.second)} | {plain(e.evidence)} | {state} |"
    lines += [f"- {plain(note)}" for note in graph.notes]
    return "\n".join(lines)
