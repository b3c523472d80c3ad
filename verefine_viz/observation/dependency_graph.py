"""Which objects touch, hide or carry which, and the order to solve them (paper Sec. IV-A; docs/methods.md 2)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from verefine_viz.core.algorithm_settings import DependencySettings
from verefine_viz.core.errors import unknown
from verefine_viz.core.problem import DependencyGraph, Edge, Problem
from verefine_viz.observation.dependency_edges import (
    BASE_M,
    contact_edges,
    lowest_m,
    meetings,
    occlusion_edges,
    support_edges,
)
from verefine_viz.observation.dependency_order import (
    Groups,
    cut_between,
    cut_by_cuthill_mckee,
    ordered,
    published_clusters,
    touching_masks,
)
from verefine_viz.observation.given_order import given_clusters, given_entries
from verefine_viz.observation.visible_parts import VisiblePart, label, visible_parts

ROUND_SHARE = 0.25
"""Height that a round body seen from above hides from the sensor, as a share of its diameter."""


@dataclass(frozen=True)
class _RuleResult:
    """The outcome of one rule."""

    edges: tuple[Edge, ...]
    clusters: Groups
    support_lists: Groups
    notes: tuple[str, ...]


def dependency_graph(problem: Problem, settings: DependencySettings) -> DependencyGraph:
    """Clusters and order of a frame's instances, with the evidence; a given order wins over the rule.

    It depends on the frame's content, not on the order of ``problem.instances``.

    Raises:
        InputError: the order file cannot be read.
        SettingsError: the order file or a given order is malformed.
    """
    entries = given_entries(settings, problem)
    parts = visible_parts(problem)
    rule = _recommended if settings.rule == "recommended" else _published
    result = rule(problem, parts, settings)
    unseen = sorted({i.instance_id for i in problem.instances} - {p.instance_id for p in parts})
    alone = tuple((i,) for i in unseen)
    notes = (*_unknown_cuts(problem, settings), *result.notes)
    notes += tuple(f"{label(problem, i)} has no depth in its mask; solved alone, behind" for i in unseen)
    clusters, lists = result.clusters + alone, result.support_lists + alone
    if entries is None:
        if settings.order_file and not settings.order:
            notes = (f"the order file gives none for frame {problem.frame}; the {settings.rule} rule's is used", *notes)
        return DependencyGraph(result.edges, clusters, lists, settings.rule, notes)
    given, given_notes = given_clusters(problem, entries, [i for cluster in clusters for i in cluster])
    given_notes += _against_support(problem, given, result.edges)
    return DependencyGraph(result.edges, given, given, "given", given_notes + notes)


def _unknown_cuts(problem: Problem, settings: DependencySettings) -> tuple[str, ...]:
    """Notes on instances that ``dependency.cut`` names but the frame lacks."""
    ids = [i.instance_id for i in problem.instances]
    known = {*ids, *(one.instance_id for one in problem.left_out)}
    absent = dict.fromkeys(i for pair in settings.cut for i in pair if i not in known)
    return tuple(f"dependency.cut: {unknown('instance', i, ids)}; it is ignored" for i in absent)


def _recommended(problem: Problem, parts: Sequence[VisiblePart], settings: DependencySettings) -> _RuleResult:
    near = meetings(parts, settings.contact_m)
    edges = (
        *contact_edges(near, settings.contact_m),
        *occlusion_edges(parts, problem.observation.depth_m, settings.occlusion_m),
    )
    notes = _no_plane(problem)
    if not notes:
        hidden = {e.second for e in edges if e.kind == "occlusion"}
        edges += support_edges(parts, near, hidden)
        diameters_m = {i.instance_id: problem.models[i.obj_id].diameter_m for i in problem.instances}
        notes = _hovering(parts, edges, diameters_m)
    order = ordered({p.instance_id: p.median_depth_m for p in parts}, _cut(parts, edges, settings))
    notes += tuple(
        f"what carries what runs in a circle; its weakest sign, that {label(problem, e.first)} carries "
        f"{label(problem, e.second)} ({e.evidence}), is left out of the order"
        for e in order.edges
        if e.state == "ambiguous"
    )
    return _RuleResult(order.edges, order.clusters, order.support_lists, notes)


def _published(problem: Problem, parts: Sequence[VisiblePart], settings: DependencySettings) -> _RuleResult:
    edges = _cut(parts, touching_masks(problem), settings)
    clusters = published_clusters(parts, edges)
    return _RuleResult(edges, clusters, clusters, _no_plane(problem))


def _cut(parts: Sequence[VisiblePart], edges: Iterable[Edge], settings: DependencySettings) -> tuple[Edge, ...]:
    """The edges; those that the settings leave out are marked as cut."""
    marked = cut_between(edges, settings.cut)
    if settings.clusters == "components":
        return marked
    return cut_by_cuthill_mckee([p.instance_id for p in parts], marked)


def _no_plane(problem: Problem) -> tuple[str, ...]:
    if problem.observation.support is not None:
        return ()
    return ("no support plane: what carries what is unknown, and objects are ordered front to back",)


def _hovering(parts: Sequence[VisiblePart], edges: Sequence[Edge], diameters_m: Mapping[int, float]) -> tuple[str, ...]:
    """Notes on objects that rest neither on the plane nor on anything seen, though nothing else hides their lower
    end.
    """
    excused = {e.second for e in edges if e.kind in ("support", "occlusion")}
    heights_m = {
        p.name: lowest_m(p)
        for p in parts
        if p.instance_id not in excused and lowest_m(p) > ROUND_SHARE * diameters_m[p.instance_id]
    }
    return tuple(
        f"{name} begins {1000 * height_m:.0f} mm above the plane and nothing is seen to carry it; what does may be "
        "hidden, or have no mask"
        for name, height_m in heights_m.items()
        if height_m > BASE_M
    )


def _against_support(problem: Problem, clusters: Groups, edges: Sequence[Edge]) -> tuple[str, ...]:
    """Notes where a given order solves an object before the one that supports it."""
    place = {i: k for k, i in enumerate(i for cluster in clusters for i in cluster)}
    return tuple(
        f"the given order solves {label(problem, e.second)} before {label(problem, e.first)}, which seems to carry it "
        f"({e.evidence})"
        for e in edges
        if e.kind == "support" and e.state == "used" and place.get(e.first, inf) > place.get(e.second, inf)
    )
