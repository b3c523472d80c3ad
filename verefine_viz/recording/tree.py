"""The search tree of PHYSIM-MCTS as it grows: a node for every object placed, the branch of the iteration marked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pyarrow as pa
import rerun as rr

from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.core.records import Iteration, TreeStep
from verefine_viz.recording import chunks, columns, entities
from verefine_viz.recording.layout import Layout
from verefine_viz.recording.piece import Piece

BESIDE, DEEPER = 34.0, 290.0
"""Between neighbouring leaves, one below the other, and from a node to its children, to the right."""
ROOT_COLOR: RGB = (150, 150, 150)
ON_BRANCH: RGB = (255, 255, 255)


@dataclass
class _Node:
    parent: int
    instance_id: int
    arm: int
    depth: int
    visits: int = 0
    cost_px: float = 0.0
    children: list[int] = field(default_factory=list)


class Tree:
    """Adds up the steps; each iteration is drawn as the whole tree it left."""

    def __init__(self, layout: Layout) -> None:
        self._names = {b.instance_id: b.name for b in layout.branches}
        self._colors = {b.instance_id: OBJECT_COLORS[k % 10] for k, b in enumerate(layout.branches)}
        self._clusters: dict[int, dict[int, _Node]] = {}

    def styles(self) -> Iterator[Piece]:
        yield _directed()

    def add(self, step: TreeStep) -> None:
        """Takes the next step."""
        nodes = self._clusters.setdefault(step.cluster, {0: _Node(-1, -1, -1, 0)})
        if step.node is not None and step.node.node not in nodes:
            parent = nodes[step.node.parent]
            nodes[step.node.node] = _Node(step.node.parent, step.node.instance_id, step.node.arm, parent.depth + 1)
            parent.children.append(step.node.node)
        for n in step.branch:
            nodes[n].visits += 1
            nodes[n].cost_px += step.cost_px

    def draw(self, iterations: Sequence[Iteration]) -> Iterator[Piece]:
        """The tree after each of the iterations that did something to it."""
        indices: list[int] = []
        ids: list[list[str]] = []
        labels: list[list[str]] = []
        positions, colors, edges = [], [], []
        for iteration in iterations:
            step = iteration.tree
            if step is None:
                continue
            self.add(step)
            nodes = self._clusters[step.cluster]
            indices.append(iteration.index)
            ids.append([str(n) for n in nodes])
            labels.append([self._label(n) for n in nodes.values()])
            places = _places(nodes)
            positions.append(np.array([places[n] for n in nodes], np.float32))
            marked = set(step.branch)
            colors.append([_packed(ON_BRANCH if n in marked else self._color(node)) for n, node in nodes.items()])
            edges.append([(str(node.parent), str(n)) for n, node in nodes.items() if n])
        if not indices:
            return
        of = rr.GraphNodes
        parts = [
            columns.texts(of.descriptor_node_ids(), ids),
            columns.texts(of.descriptor_labels(), labels),
            columns.vectors(of.descriptor_positions(), positions, 2),
            columns.numbers(of.descriptor_colors(), colors, np.uint32),
            columns.of_arrow(rr.GraphEdges.descriptor_edges(), _pairs(edges)),
        ]
        yield chunks.rows_of(entities.TREE, indices, parts)

    def _label(self, node: _Node) -> str:
        if not node.depth:
            return f"nothing placed, {node.visits}×"
        name = self._names.get(node.instance_id, f"#{node.instance_id}")
        mean_px = node.cost_px / max(node.visits, 1)
        return f"{name} h{node.arm + 1}, {node.visits}×, {mean_px:.0f} px"

    def _color(self, node: _Node) -> RGB:
        return self._colors.get(node.instance_id, ROOT_COLOR)


def _places(nodes: dict[int, _Node]) -> dict[int, tuple[float, float]]:
    """Leaves one below the other, parents to the left of the middle of their children."""
    places: dict[int, tuple[float, float]] = {}
    leaves = 0
    order: list[int] = []
    waiting = [0]
    while waiting:
        n = waiting.pop()
        order.append(n)
        waiting += reversed(nodes[n].children)
    for n in order:
        if not nodes[n].children:
            places[n] = (DEEPER * nodes[n].depth, BESIDE * leaves)
            leaves += 1
    for n in reversed(order):
        children = nodes[n].children
        if children:
            middle = (places[children[0]][1] + places[children[-1]][1]) / 2
            places[n] = (DEEPER * nodes[n].depth, middle)
    return places


def _packed(color: RGB) -> int:
    return (color[0] << 24) | (color[1] << 16) | (color[2] << 8) | 255


def _pairs(rows: Sequence[Sequence[tuple[str, str]]]) -> pa.ListArray:
    item = pa.struct([pa.field("first", pa.string(), nullable=False), pa.field("second", pa.string(), nullable=False)])
    ends = [pa.array([edge[k] for row in rows for edge in row], pa.string()) for k in (0, 1)]
    flat = pa.StructArray.from_arrays(ends, fields=list(item))
    offsets = np.cumsum([0, *(len(row) for row in rows)]).astype(np.int32)
    return pa.ListArray.from_arrays(pa.array(offsets), flat)


@cache
def _directed() -> Piece:
    return chunks.fixed(entities.TREE, rr.GraphEdges.from_fields(graph_type="directed"))
