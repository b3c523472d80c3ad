"""Exact nearest neighbours in a cloud that stays the same: built once per model, queried from compiled loops.

A balanced tree of tight boxes with a few points in each leaf. A query starts from a guess (the match of the point
before it, or its own match an iteration ago), which prunes most of the tree at once. Single-threaded, and the answer
for a query does not depend on the guess but for exact ties.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float

LEAF_POINTS = 8
"""Most points in a leaf, about."""


@dataclass(frozen=True, eq=False)
class NearestIndex:
    """The search tree of one cloud. Nodes are numbered as in a heap: the children of i are 2i + 1 and 2i + 2."""

    points: Float
    """(N, 3) the cloud, reordered so that every node's points are a slice."""
    order: NDArray[np.int64]
    """(N,) the place of each of ``points`` in the cloud it was built from."""
    boxes: Float
    """(nodes, 6) tight bounds: low x, y, z, high x, y, z."""
    slices: NDArray[np.int64]
    """(nodes, 2) first point and end."""

    @staticmethod
    def build(cloud: Float) -> NearestIndex:
        """The tree of a cloud (N, 3) of at least one point."""
        n = len(cloud)
        depth = max(0, int(np.ceil(np.log2(n / LEAF_POINTS))))
        n_nodes = 2 ** (depth + 1) - 1
        order = np.arange(n)
        boxes = np.empty((n_nodes, 6))
        slices = np.empty((n_nodes, 2), dtype=np.int64)
        slices[0] = 0, n
        for node in range(n_nodes):
            a, b = slices[node]
            own = order[a:b]
            boxes[node, :3], boxes[node, 3:] = cloud[own].min(axis=0), cloud[own].max(axis=0)
            if 2 * node + 2 < n_nodes:
                widest = int(np.argmax(boxes[node, 3:] - boxes[node, :3]))
                order[a:b] = own[np.argsort(cloud[own, widest], kind="stable")]
                middle = (a + b) // 2
                slices[2 * node + 1] = a, middle
                slices[2 * node + 2] = middle, b
        return NearestIndex(np.ascontiguousarray(cloud[order], dtype=np.float64), order, boxes, slices)

    def query(self, points: Float) -> tuple[Float, NDArray[np.int64]]:
        """Distance to, and index in the original cloud of, the nearest neighbour of each of ``points`` (M, 3)."""
        squared, nearest = _query_all(
            np.ascontiguousarray(points, dtype=np.float64), self.points, self.boxes, self.slices
        )
        return np.sqrt(squared), self.order[nearest]


@njit(cache=True, inline="always")
def _box_distance(x: float, y: float, z: float, boxes: np.ndarray, node: int) -> float:
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@njit(cache=True)
def nearest(
    x: float, y: float, z: float, guess: int, points: np.ndarray, boxes: np.ndarray, slices: np.ndarray,
    stack: np.ndarray, stack_distance: np.ndarray,
) -> tuple[int, float]:  # fmt: skip
    """Index into the reordered ``points`` of the nearest to (x, y, z), and its squared distance.

    ``guess`` is any index; ``stack`` and ``stack_distance`` are scratch space of at least the tree's depth.
    """
    best = guess
    dx, dy, dz = points[guess, 0] - x, points[guess, 1] - y, points[guess, 2] - z
    best_squared = dx * dx + dy * dy + dz * dz
    n_nodes = len(slices)
    node = 0
    top = 0
    while True:
        left = 2 * node + 1
        if left < n_nodes:
            a = _box_distance(x, y, z, boxes, left)
            b = _box_distance(x, y, z, boxes, left + 1)
            near, far = left, left + 1
            if b < a:
                near, far = far, near
                a, b = b, a
            if b < best_squared:
                stack[top] = far
                stack_distance[top] = b
                top += 1
            if a < best_squared:
                node = near
                continue
        else:
            for i in range(slices[node, 0], slices[node, 1]):
                dx, dy, dz = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
                squared = dx * dx + dy * dy + dz * dz
                if squared < best_squared:
                    best_squared = squared
                    best = i
        while top > 0 and stack_distance[top - 1] >= best_squared:
            top -= 1
        if top == 0:
            return best, best_squared
        top -= 1
        node = stack[top]


@njit(cache=True)
def _query_all(
    queries: np.ndarray, points: np.ndarray, boxes: np.ndarray, slices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    squared = np.empty(len(queries))
    found = np.empty(len(queries), dtype=np.int64)
    stack = np.empty(64, dtype=np.int64)
    stack_distance = np.empty(64)
    guess = 0
    for i in range(len(queries)):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        guess, squared[i] = nearest(x, y, z, guess, points, boxes, slices, stack, stack_distance)
        found[i] = guess
    return squared, found
