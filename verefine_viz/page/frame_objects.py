"""The objects of a frame as the page names, colours and orders them."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from verefine_viz.core.palette import OBJECT_COLORS, RGB
from verefine_viz.core.problem import Problem, Target
from verefine_viz.methods.known_methods import method_of

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch


def labels_of(problem: Problem) -> dict[int, str]:
    """Name the objects by instance_id; where one is there twice, with the instance."""
    often = Counter(i.obj_id for i in problem.instances)
    return {
        i.instance_id: problem.models[i.obj_id].name + (f" #{i.instance_id}" if often[i.obj_id] > 1 else "")
        for i in problem.instances
    }


def color_of(index: int) -> RGB:
    """Return the colour of the instance at that place of ``problem.instances``."""
    return OBJECT_COLORS[index % len(OBJECT_COLORS)]


def clusters_of(branch: Branch) -> tuple[tuple[int, ...], ...]:
    """Return the clusters in which objects are solved; each object alone where the method does not know others."""
    problem = branch.run.problem
    ids = [i.instance_id for i in problem.instances]
    if not method_of(branch.settings.method.name).knows_others:
        return tuple((i,) for i in ids)
    clusters = tuple(tuple(i for i in cluster if i in ids) for cluster in problem.clusters)
    missing = set(ids) - {i for cluster in clusters for i in cluster}
    return (*filter(None, clusters), *((i,) for i in sorted(missing)))


def state_of(state: Any, target: Target) -> Any:
    """Return the method's state of one object; None where it has no hypothesis."""
    ids = [t.instance.instance_id for t in state.problem.targets]
    return state.objects[ids.index(target.instance.instance_id)]
