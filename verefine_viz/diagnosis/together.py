"""Re-runs of methods that solve the objects of a scene together (vf_depth, physim_mcts), as the session has them.

Each takes as long as the run itself took with these objects, so that a diagnosis makes few: one for misplaced
neighbours; one, with a single hypothesis of each object, for each of up to three hypotheses that come out right on
their own; and larger budgets where there is reason to think that it was too small.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from verefine_viz.core.problem import Hypothesis, Problem
from verefine_viz.core.records import Best
from verefine_viz.methods.registry import method_of
from verefine_viz.session.engine import Run
from verefine_viz.session.toolbox import Toolbox

Pools = Mapping[int, Sequence[Hypothesis]]
"""First poses by instance_id, instead of an instance's own."""


def company_of(problem: Problem, instance_id: int) -> tuple[int, ...]:
    """The instances of the same cluster that have a hypothesis, itself included."""
    cluster = next(c for c in problem.clusters if instance_id in c)
    return tuple(i for i in cluster if problem.target(i).instance.hypotheses)


def solved_together(
    toolbox: Toolbox, problem: Problem, instance_id: int, pools: Pools, times: int = 1, iterations: int | None = None
) -> Best | None:
    """The answer for one instance when the session's method solves its cluster again.

    Poses moved by hand and settings changed on the way are not repeated.

    Args:
        toolbox: the run's.
        problem: the run's frame.
        instance_id: whose answer is wanted.
        pools: other first poses.
        times: multiple of the run's budget.
        iterations: K, per hypothesis, instead of the run's; the search counts expansions, whatever the pools.
    """
    session = toolbox.session
    fields: dict[str, dict[str, Any]] = {}
    if method_of(session.method.name).has_tree:
        seconds = session.mcts.seconds
        fields["mcts"] = {"expansions": times * session.mcts.expansions}
        fields["mcts"] |= {"seconds": times * seconds} if seconds is not None else {}
    else:
        fields["method"] = {"iterations": iterations or times * session.method.iterations}
    carries = not method_of(session.method.name).has_tree and session.method.carry_clusters
    needed = _needed(problem, instance_id, carries)
    part = problem.only(needed)
    instances = tuple(replace(i, hypotheses=tuple(pools.get(i.instance_id, i.hypotheses))) for i in part.instances)
    run = Run(toolbox.restarted(fields).method, replace(part, instances=instances))
    answers = run.finish().best
    ids = [i.instance_id for i in instances]
    return answers[ids.index(instance_id)]


def _needed(problem: Problem, instance_id: int, clusters_carry: bool) -> list[int]:
    """What has a part in an instance's answer: its cluster and, where they stay in the scene, those before."""
    clusters = problem.clusters
    k = next(k for k, cluster in enumerate(clusters) if instance_id in cluster)
    return [i for cluster in clusters[0 if clusters_carry else k : k + 1] for i in cluster]
