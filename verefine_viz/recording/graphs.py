"""Graphs of a recording: which objects depend on which, and the search tree of PHYSIM-MCTS as it grows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import rerun as rr

from verefine_viz.core.palette import RGB
from verefine_viz.core.problem import DependencyGraph, Edge, EdgeKind
from verefine_viz.core.records import Iteration
from verefine_viz.pictures.visited_tree import ROOT, DrawnNode, GrowingTree
from verefine_viz.recording import entities
from verefine_viz.recording.iteration_text import plain
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.recording_file import RecordingFile

NODE_WIDTH = 210.0
"""Width of a node with its label."""
VERBS: Mapping[EdgeKind, str] = {"contact": "may touch", "occlusion": "hides", "support": "supports"}
BESIDE, DEEPER = 34.0, 290.0
"""Distances in a tree: between neighbouring leaves, downwards, and from a node to its children, to the right."""
ROOT_COLOR: RGB = (150, 150, 150)
ON_BRANCH: RGB = (255, 255, 255)


def log_dependencies(file: RecordingFile, graph: DependencyGraph, layout: Layout) -> None:
    """Log nodes, edges and evidence; static."""
    names = {b.instance_id: b.name for b in layout.branches}
    rank = {i: n for n, i in enumerate(graph.order, start=1)}
    known = [i for i in graph.order if i in names]
    nodes = rr.GraphNodes(
        node_ids=[names[i] for i in known],
        labels=[f"{rank[i]}. {names[i]} (cluster {graph.cluster_of(i) + 1})" for i in known],
        colors=[layout.colors[i] for i in known],
        radii=[12.0] * len(known),
        positions=_ring_positions([[i for i in cluster if i in names] for cluster in graph.clusters]),
    )
    pairs = [
        pair
        for e in graph.edges
        if e.state == "used" and {e.first, e.second} <= set(known)
        for pair in _arrows(e, names)
    ]
    # Nodes and edges in different entities would be different graphs.
    file.log(entities.GRAPH_OBJECTS, nodes, rr.GraphEdges(pairs, graph_type="directed"))
    file.log(entities.EVIDENCE, rr.TextDocument(_evidence(graph, names), media_type="text/markdown"))


def _ring_positions(clusters: Sequence[Sequence[int]]) -> list[tuple[float, float]]:
    """Positions of the nodes: clusters in rows and columns, each a ring in solving order from the top, so that no edge
    of a cluster runs through a third node.
    """
    largest = max(map(len, clusters), default=1)
    across, down = (NODE_WIDTH * max(2.0, math.sqrt(largest)) * f for f in (1.0, 0.6))
    n_columns = math.ceil(math.sqrt(len(clusters)))
    positions: list[tuple[float, float]] = []
    for k, cluster in enumerate(clusters):
        x, y, n = across * (k % n_columns), down * (k // n_columns), len(cluster)
        radius = 0.35 * across if n > 1 else 0.0
        for angle in (2 * math.pi * j / n for j in range(n)):
            positions.append((x + radius * math.sin(angle), y - 0.35 * down * math.cos(angle)))
    return positions


def _arrows(edge: Edge, names: Mapping[int, str]) -> list[tuple[str, str]]:
    """Arrow from the object that supports or hides to the other; both ways where the two may merely touch."""
    first, second = names[edge.first], names[edge.second]
    return [(first, second), (second, first)] if edge.kind == "contact" else [(first, second)]


def _evidence(graph: DependencyGraph, names: Mapping[int, str]) -> str:
    """The order and its evidence, as markdown."""

    def name(instance_id: int) -> str:
        return plain(names.get(instance_id, f"#{instance_id}"))

    lines = [f"## Order ({graph.source})"]
    for k, cluster in enumerate(graph.clusters, start=1):
        lines.append(f"{k}. {' → '.join(name(i) for i in cluster)}")
    stacks = [c for c in graph.support_lists if len(c) > 1]
    if stacks:
        lines.append("\n## Stacks")
        lines += [f"- {name(base)} supports {', '.join(name(i) for i in rest)}" for base, *rest in stacks]
    lines.append("\n## Evidence\n| | | | evidence | |\n|-|-|-|-|-|")
    for e in graph.edges:
        state = "" if e.state == "used" else f"**{e.state}**"
        lines[-1] += f"\n| {name(e.first)} | {VERBS[e.kind]} | {name(e.second)} | {plain(e.evidence)} | {state} |"
    lines += [f"- {plain(note)}" for note in graph.notes]
    return "\n".join(lines)


class TreeGraphs:
    """The growing search trees; each iteration is drawn as the whole tree after it."""

    def __init__(self, layout: Layout) -> None:
        self._layout = layout
        self._by_cluster: dict[int, GrowingTree] = {}

    def send(self, file: RecordingFile, iterations: Sequence[Iteration]) -> None:
        """The tree after each of the next iterations that changed it."""
        steps = [(i.index, i.tree) for i in iterations if i.tree is not None]
        if not steps:
            return
        labels: list[str] = []
        positions: list[tuple[float, float]] = []
        colors: list[RGB] = []
        edges: list[tuple[str, str]] = []
        n_nodes: list[int] = []
        own_colors = {ROOT: ROOT_COLOR} | self._layout.colors
        for index, step in steps:
            growing = self._by_cluster.setdefault(step.cluster, GrowingTree(step.cluster))
            growing.add(index, step)
            nodes = growing.tree.nodes
            n_nodes.append(len(nodes))
            labels += [self._label(node) for node in nodes]
            positions += _tree_positions(nodes)
            colors += [ON_BRANCH if n.number in step.branch else own_colors[n.instance_id] for n in nodes]
            edges += [(str(node.parent), str(node.number)) for node in nodes[1:]]
        ids = [str(k) for n in n_nodes for k in range(n)]
        graph_nodes = rr.GraphNodes.columns(node_ids=ids, labels=labels, positions=positions, colors=colors)
        graph_edges = rr.GraphEdges.columns(edges=edges) if edges else []
        file.send(
            entities.TREE,
            [index for index, _ in steps],
            graph_nodes.partition(n_nodes),
            [column.partition([n - 1 for n in n_nodes]) for column in graph_edges],
        )

    def _label(self, node: DrawnNode) -> str:
        if not node.depth:
            return f"nothing placed, {node.visits}×"
        name = self._layout.branch(node.instance_id).name
        return f"{name} h{node.arm + 1}, {node.visits}×, {node.cost_px / max(node.visits, 1):.0f} px"


def _tree_positions(nodes: Sequence[DrawnNode]) -> list[tuple[float, float]]:
    """Positions of a tree's nodes: leaves one below another, parents to the left of the middle of their children."""
    down = [0.0] * len(nodes)
    n_leaves = 0
    parents_first: list[DrawnNode] = []
    waiting = [nodes[0]]
    while waiting:
        node = waiting.pop()
        parents_first.append(node)
        waiting += [nodes[k] for k in reversed(node.children)]
        if not node.children:
            down[node.number] = BESIDE * n_leaves
            n_leaves += 1
    for node in reversed(parents_first):
        if node.children:
            down[node.number] = (down[node.children[0]] + down[node.children[-1]]) / 2
    return [(DEEPER * node.depth, down[node.number]) for node in nodes]
