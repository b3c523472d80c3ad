"""Changes of the order in which objects are solved, and of what stops them, made as settings: a saved session repeats
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import Problem
from verefine_viz.page.branch import Branch
from verefine_viz.page.protocol import Order
from verefine_viz.page.workspace import Workspace


def reordered(space: Workspace, branch: Branch, verb: Order) -> dict[str, Any]:
    """Return the settings that change the order, or what stops the objects, as a session file has them."""
    problem = space.problem
    graph, session = problem.dependencies, branch.tools.session
    if verb.reset:
        return {"dependency.order": (), "dependency.order_file": ""}
    if verb.drop is not None:
        number, drop = verb.drop
        support = problem.observation.support
        around = support.surroundings if support is not None else None
        numbers = [one.number for one in around.unknown] if around is not None else []
        if number not in numbers:
            raise InputError(unknown("unknown object", number, numbers))
        others = tuple(other for other in session.physics.dropped if other != (space.frame, number))
        return {"physics.dropped": (*others, (space.frame, number)) if drop else others}
    if graph is None:
        raise InputError("how the objects of this frame depend on each other is unknown")
    if verb.cut is not None:
        first, second, cut = verb.cut
        pairs = {frozenset((e.first, e.second)) for e in graph.edges}
        if frozenset((first, second)) not in pairs:
            there = [f"#{min(pair)} and #{max(pair)}" for pair in sorted(pairs, key=sorted)]
            raise InputError(unknown("pair of instances", f"#{first} and #{second}", there))
        others = tuple(pair for pair in session.dependency.cut if set(pair) != {first, second})
        return {"dependency.cut": (*others, (min(first, second), max(first, second))) if cut else others}
    if verb.move is None or verb.move[1] not in (-1, 1):
        raise InputError("an object moves by one place at a time, -1 or 1")
    instance_id, by = verb.move
    there = [i for cluster in graph.clusters for i in cluster]
    if instance_id not in there:
        raise InputError(unknown("instance", instance_id, there))
    clusters = moved(graph.clusters, instance_id, by)
    if clusters is None:
        raise InputError(f"instance {instance_id} is {'first' if by < 0 else 'last'} in the order already")
    return {"dependency.order": as_entries(problem, clusters)}


Clusters = tuple[tuple[int, ...], ...]


def as_entries(problem: Problem, clusters: Clusters) -> tuple[tuple[int | str, ...], ...]:
    """Write clusters as a session file does: by object, or by instance where the frame has an object twice."""
    obj_ids = {i.instance_id: i.obj_id for i in problem.instances}
    there = list(obj_ids.values())
    return tuple(
        tuple(obj_ids[i] if there.count(obj_ids[i]) == 1 else f"#{i}" for i in cluster) for cluster in clusters
    )


def moved(clusters: Clusters, instance_id: int, by: int) -> Clusters | None:
    """Move an instance by one place in its cluster, or at the cluster's end the whole cluster; None where it cannot
    move.

    Args:
        clusters: in the order to solve them.
        instance_id: what moves.
        by: −1 earlier, 1 later.
    """
    k = next(k for k, cluster in enumerate(clusters) if instance_id in cluster)
    within = _swapped(clusters[k], clusters[k].index(instance_id), by)
    if within is not None:
        return (*clusters[:k], within, *clusters[k + 1 :])
    return _swapped(clusters, k, by)


def _swapped(items: Sequence, at: int, by: int) -> tuple | None:
    to = at + by
    if not 0 <= to < len(items):
        return None
    swapped = list(items)
    swapped[at], swapped[to] = swapped[to], swapped[at]
    return tuple(swapped)
