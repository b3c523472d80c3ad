"""Clusters and order as the authors' code has them, with connected components done right. docs/methods.md 2.2."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from verefine_viz.core.arrays import Mask
from verefine_viz.core.dependency import Edge
from verefine_viz.core.problem import Problem
from verefine_viz.observation.dependency_order import Groups, connected
from verefine_viz.observation.visible_parts import VisiblePart


def touching_masks(problem: Problem) -> tuple[Edge, ...]:
    """An edge between instances whose measured pixels share one when each is dilated by one 4-neighbour step."""
    depth_m = problem.observation.depth_m
    grown = {i.instance_id: _grown(i.mask, depth_m) for i in problem.instances}
    edges = []
    for a, b in combinations(sorted(grown), 2):
        shared = int(np.count_nonzero(grown[a] & grown[b]))
        if shared:
            smaller = min(np.count_nonzero(grown[a]), np.count_nonzero(grown[b]))
            edges.append(Edge("contact", a, b, float(shared / smaller), f"masks share {shared} px when grown by one"))
    return tuple(edges)


def published_clusters(parts: Sequence[VisiblePart], edges: Sequence[Edge]) -> Groups:
    """In each cluster the lower tops come first; the cluster whose first object is nearest comes first.

    Without a plane heights are not known; the nearer comes first then.
    """
    by_id = {p.instance_id: p for p in parts}
    nearest_m = {i: float(p.points_cam[:, 2].min()) for i, p in by_id.items()}

    def top(instance_id: int) -> tuple[float, float, int]:
        part = by_id[instance_id]
        top_m = float(part.heights_m.max()) if part.points_plane is not None else 0.0
        return top_m, nearest_m[instance_id], instance_id

    clusters = [tuple(sorted(group, key=top)) for group in connected(by_id, [e for e in edges if e.state != "cut"])]
    return tuple(sorted(clusters, key=lambda cluster: (nearest_m[cluster[0]], cluster[0])))


def _grown(mask: Mask, depth_m: NDArray[np.floating]) -> Mask:
    return np.asarray(binary_dilation(mask & (depth_m > 0)), dtype=bool)
