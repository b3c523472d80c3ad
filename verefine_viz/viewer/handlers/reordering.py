"""Changes of the dependency order by hand, as changed settings: a saved session then repeats them."""

from __future__ import annotations

from collections.abc import Sequence

from verefine_viz.core.algorithm_settings import DependencySettings
from verefine_viz.core.errors import InputError, unknown
from verefine_viz.core.problem import DependencyGraph, Problem
from verefine_viz.viewer import commands as c
from verefine_viz.viewer.commands import CutDependency, MoveInOrder, ResetOrder

Clusters = tuple[tuple[int, ...], ...]


def as_restart(
    command: CutDependency | MoveInOrder | ResetOrder, problem: Problem, settings: DependencySettings
) -> c.Restart:
    """The restart that a command about the order stands for.

    Raises:
        InputError: nothing is known to be between the two instances, an instance does not exist or stands at the end.
    """
    match command:
        case CutDependency(first, second, cut):
            return c.Restart((("dependency.cut", _cut(problem, settings, first, second, cut)),))
        case MoveInOrder(instance_id, by):
            return c.Restart((("dependency.order", entries(problem, _moved(problem, instance_id, by))),))
        case ResetOrder():
            return c.Restart((("dependency.order", ()), ("dependency.order_file", "")))


def entries(problem: Problem, clusters: Clusters) -> tuple[tuple[int | str, ...], ...]:
    """Clusters as a session file names them: by object, or by instance where an object is there twice."""
    obj_ids = {i.instance_id: i.obj_id for i in problem.instances}
    there = list(obj_ids.values())
    return tuple(
        tuple(obj_ids[i] if there.count(obj_ids[i]) == 1 else f"#{i}" for i in cluster) for cluster in clusters
    )


def moved(clusters: Clusters, instance_id: int, by: int) -> Clusters | None:
    """Clusters with an instance one place earlier or later; None where it stands at the end already."""
    k = next(k for k, cluster in enumerate(clusters) if instance_id in cluster)
    within = _swapped(clusters[k], clusters[k].index(instance_id), by)
    if within is not None:
        return (*clusters[:k], within, *clusters[k + 1 :])
    return _swapped(clusters, k, by)


def _cut(
    problem: Problem, settings: DependencySettings, first: int, second: int, cut: bool
) -> tuple[tuple[int, int], ...]:
    pairs = {frozenset((e.first, e.second)) for e in _graph(problem).edges}
    if frozenset((first, second)) not in pairs:
        there = [f"#{min(pair)} and #{max(pair)}" for pair in sorted(pairs, key=sorted)]
        raise InputError(unknown("pair of instances", f"#{first} and #{second}", there))
    others = tuple(pair for pair in settings.cut if set(pair) != {first, second})
    return (*others, (min(first, second), max(first, second))) if cut else others


def _moved(problem: Problem, instance_id: int, by: int) -> Clusters:
    clusters = _graph(problem).clusters
    there = [i for cluster in clusters for i in cluster]
    if instance_id not in there:
        raise InputError(unknown("instance", instance_id, there))
    if by not in (-1, 1):
        raise InputError(f"an object moves by one place at a time, -1 or 1, not {by}")
    found = moved(clusters, instance_id, by)
    if found is None:
        raise InputError(f"instance {instance_id} is {'first' if by < 0 else 'last'} in the order already")
    return found


def _swapped(items: Sequence, at: int, by: int) -> tuple | None:
    to = at + by
    if not 0 <= to < len(items):
        return None
    swapped = list(items)
    swapped[at], swapped[to] = swapped[to], swapped[at]
    return tuple(swapped)


def _graph(problem: Problem) -> DependencyGraph:
    if problem.dependencies is None:
        raise InputError("how the objects of this frame depend on each other was not looked at")
    return problem.dependencies
