"""Whether the objects can stand where they are, and what the simulation did: answer to the want ``physics``."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float
from verefine_viz.core.geometry import apply
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed, Problem, Target
from verefine_viz.core.records import Contacts, Iteration, SimulatedPath
from verefine_viz.core.settings import BULLET
from verefine_viz.core.surroundings import SUPPORT_ID, UnknownObject
from verefine_viz.methods.known_methods import method_of
from verefine_viz.page import protocol as p
from verefine_viz.page.answers_to_wants import (
    Light,
    OverlappingPair,
    PhysicsAnswer,
    PlaneFit,
    Point,
    PosePhysics,
    SimulatedMotion,
    SupportAround,
    TippingMoment,
    TouchedPartner,
    UnknownSolid,
)
from verefine_viz.page.blobs import Blobs
from verefine_viz.page.frame_objects import labels_of
from verefine_viz.page.views.physics_doubts import doubts_of, height_above_plane_m
from verefine_viz.page.wire import pose_numbers
from verefine_viz.physics.stability import IMPOSSIBLE_M
from verefine_viz.run.iteration_words import moved_by_mm, name_of_contact, turned_by

if TYPE_CHECKING:
    from verefine_viz.page.branch import Branch
    from verefine_viz.page.evaluator import CachedEvaluator
    from verefine_viz.page.workspace import Workspace

OUTLINE_POINTS = 4000
"""Model points from which an outline seen from above is made."""


@dataclass(frozen=True, eq=False)
class StandingObjects:
    """Objects where they stand, by instance_id, and what works out what geometry says of them."""

    branch: Branch
    evaluator: CachedEvaluator
    placed: Mapping[int, Placed]
    waiting: Collection[int]
    """Those that stand at an initial pose, as their turn is still to come."""

    @property
    def problem(self) -> Problem:
        return self.branch.run.problem

    def others_of(self, instance_id: int) -> tuple[Placed, ...]:
        """Return the other objects."""
        return tuple(placed for other, placed in self.placed.items() if other != instance_id)


def physics(space: Workspace, want: p.PhysicsWanted, blobs: Blobs) -> PhysicsAnswer:
    """Return what physics says about objects where they stand, and about the focus before and after.

    Raises:
        InputError: there is no such object or iteration.
    """
    branch = space.branch(want.branch)
    problem, target = branch.run.problem, branch.run.problem.target(want.obj)
    support = problem.observation.support
    known = PhysicsAnswer(
        empty=_off_reason(branch),
        doubts=doubts_of(branch, support),
        surroundings=None if support is None else _surroundings(support),
        objects=(),
        poses=(),
        overlaps=(),
        path=None if want.path is None else _path(branch, branch.iteration(want.path)),
    )
    if support is None:
        return known
    placed = {one.obj: Placed(one.obj, problem.target(one.obj).model, p.pose_matrix(one.T)) for one in want.stands}
    around = StandingObjects(branch, branch.evaluator_of(want.k), placed, {o.obj for o in want.stands if o.waits})
    asked = [obj for obj in placed if not want.alone or obj == want.obj]
    return replace(
        known,
        objects=[_facts(around, problem.target(obj), placed[obj].T_cam_obj) for obj in asked],
        poses=[_drawn_facts(around, target, p.pose_matrix(T), name, support) for name, T in want.poses],
        overlaps=_overlaps(around, want.obj if want.alone else None),
    )


def _facts(around: StandingObjects, target: Target, T_cam_obj: Float, name: str = "") -> PosePhysics:
    """Return what geometry says about a pose of an object among the others; ``name``: of the pose."""
    instance_id, labels = target.instance.instance_id, labels_of(around.problem)
    known = around.evaluator.plausibility(target, T_cam_obj, around.others_of(instance_id))
    if known is None:
        return PosePhysics(instance_id, name, "grey", "Physics is not asked here.")
    tone, words = _verdict(around, target, known)
    return PosePhysics(
        obj=instance_id,
        name=name,
        tone=tone,
        words=words,
        gap_mm=known.gap_mm,
        depth_mm=known.penetration_mm,
        into=None if known.penetrates is None else name_of_contact(known.penetrates, labels),
        margin_mm=float(known.margin_mm) if np.isfinite(known.margin_mm) else None,
        stable=known.is_stable,
        touches=sorted({name_of_contact(int(i), labels) for i in known.contact_others}),
    )


def _drawn_facts(around: StandingObjects, target: Target, T_cam_obj: Float, name: str, support: Support) -> PosePhysics:
    """Return what geometry says about a pose of the focus, with what a picture from above needs."""
    facts, T_world_cam = _facts(around, target, T_cam_obj, name), support.T_world_cam
    known = around.evaluator.plausibility(target, T_cam_obj, around.others_of(target.instance.instance_id))
    if known is None:
        return facts
    points = target.model.points
    seen = apply(T_world_cam @ T_cam_obj, points[:: max(1, len(points) // OUTLINE_POINTS)])[:, :2]
    return replace(
        facts,
        outline=_mm(hull(seen)),
        polygon=_mm(apply(T_world_cam, known.polygon_cam)[:, :2]),
        com=_mm(apply(T_world_cam, known.com_on_plane_cam[None])[:, :2])[0],
        contacts=_mm(apply(T_world_cam, known.contact_points_cam)[:, :2]),
    )


def _verdict(around: StandingObjects, target: Target, known: Any) -> tuple[Light, str]:
    """Return light and words; grey where a pose hangs on an object that is not placed yet.

    Where ground truth is known, sinking into the support plane counts from where ground truth is: a measured table lies
    millimetres beside it in places, far more than the scatter of its points says.
    """
    light, sentence = known.light, known.sentence
    into = next((other for other in around.placed if f"into instance {other}." in sentence), None)
    if into is not None:
        named = sentence.removesuffix(f"instance {into}.") + labels_of(around.problem)[into]
        if into in around.waiting:
            return "grey", f"{named}, which still waits at its initial pose: unknown yet."
        return light, f"{named}."
    if light == "red" and known.penetrates == SUPPORT_ID and known.penetration_mm > known.tolerance_mm:
        true_mm = -1e3 * (height_above_plane_m(target) or 0.0)
        if true_mm > 0 and known.penetration_mm - true_mm <= 1e3 * IMPOSSIBLE_M:
            why = f"so does ground truth, by {true_mm:.1f} mm: it is the measured plane that is off here"
            return "amber", f"{sentence.removesuffix('.')}; {why}."
    return light, sentence


def _overlaps(around: StandingObjects, only: int | None) -> list[OverlappingPair]:
    """Return pairs of objects that are partly in the same place, deepest first; the one solved later is named first.

    Args:
        around: the objects.
        only: the object that is in every pair; None = all pairs.
    """
    out = []
    for first, second in combinations(around.placed.values(), 2):
        if only is not None and only not in (first.instance_id, second.instance_id):
            continue
        if first.instance_id == only:
            first, second = second, first
        overlap = around.evaluator.overlap(second, first)
        if overlap is not None:
            out.append(OverlappingPair(second.instance_id, first.instance_id, overlap.depth_mm))
    return sorted(out, key=lambda one: -one.depth_mm)


def _path(branch: Branch, iteration: Iteration) -> SimulatedMotion | None:
    """Return the simulated path of an iteration: how far the object came and what it touched, step by step."""
    path, problem = iteration.path, branch.run.problem
    if path is None:
        return None
    T_0, points = path.Ts_cam_obj[0], problem.target(iteration.instance_id).model.points
    return SimulatedMotion(
        k=iteration.index,
        n=len(path.Ts_cam_obj),
        poses=[pose_numbers(T) for T in path.Ts_cam_obj],
        moved_mm=[moved_by_mm(T_0, T, points) for T in path.Ts_cam_obj],
        turned_deg=[turned_by(T_0, T)[0] for T in path.Ts_cam_obj],
        contacts=[_contacts(labels_of(problem), contacts) for contacts in path.contacts],
        has_contacts=branch.settings.physics.simulator == BULLET,
        tipping=_tipping(path),
        words=_path_words(iteration, path),
    )


def _contacts(labels: Mapping[int, str], contacts: Contacts) -> list[TouchedPartner]:
    """Return what is touched at the end of a step, a row per partner, the hardest pressed first."""
    rows = []
    for other in np.unique(contacts.others):
        own = contacts.others == other
        rows.append(
            TouchedPartner(
                name=name_of_contact(int(other), labels),
                n=int(own.sum()),
                force_n=float(contacts.forces_n[own].sum()),
                depth_mm=float(1e3 * contacts.depths_m[own].max()),
            )
        )
    return sorted(rows, key=lambda row: -row.force_n)


def _tipping(path: SimulatedPath) -> TippingMoment | None:
    tipping = path.tipping
    return None if tipping is None else TippingMoment(tipping.step, 1e3 * tipping.overhang_m)


def _path_words(iteration: Iteration, path: SimulatedPath) -> str:
    """Say what the refiner made of the simulation's turn, and whether the object tips."""
    words = []
    if path.tipping is not None:
        overhang_mm = 1e3 * path.tipping.overhang_m
        words.append(
            f"There it would tip: after step {path.tipping.step} its centre of mass is {overhang_mm:.1f} mm "
            "outside what it touches."
        )
    refined = next((s for s in iteration.stages if s.name == "refined"), None)
    if refined is not None:
        turned_deg = turned_by(path.Ts_cam_obj[0], path.T_cam_obj)[0]
        left_deg = turned_by(path.Ts_cam_obj[0], refined.T_cam_obj)[0]
        if turned_deg > 2 and left_deg < turned_deg / 2:
            words.append(f"The refiner left {left_deg:.1f}° of the simulation's {turned_deg:.1f}°.")
    return " ".join(words)


# The frame: why there is no physics, what is doubtful, what stands around.


def _off_reason(branch: Branch) -> str:
    """Say why nothing is simulated; "" where it is."""
    observation, session = branch.run.problem.observation, branch.settings
    if observation.support is None:
        return f"No physics: {observation.support_note or 'no support plane was found'}."
    if not session.physics.enabled:
        return "Physics is off in the settings: nothing is simulated."
    method = method_of(session.method.name)
    return "" if method.simulates else f"{method.label} does not simulate."


def _surroundings(support: Support) -> SupportAround:
    """Return what supports and stops the objects: the plane alone, or what the depth image or a mesh shows."""
    around = support.surroundings
    plane = PlaneFit(support.inlier_share, 1e3 * support.rms_m, support.tilt_deg)
    if around is None:
        return SupportAround("plane", plane, surfaces=1, solids=0, unknown=())
    return SupportAround(
        source=around.source,
        plane=plane,
        surfaces=len(around.supporting) - around.catches,
        solids=len(around.solids) - len(around.surfaces),
        unknown=[_unknown(one) for one in around.unknown],
    )


def _unknown(one: UnknownObject) -> UnknownSolid:
    size = np.sort(np.ptp(one.model.vertices, axis=0) * 1e3)[::-1]
    return UnknownSolid(one.number, size.tolist(), one.is_dropped)


def hull(xy: Float) -> Float:
    """Return the corners of the convex hull of points (n, 2) in order."""
    try:
        return xy[ConvexHull(xy).vertices]
    except QhullError:  # All on a line.
        return xy[:2]


def _mm(xy: Float | Sequence[Float]) -> list[Point]:
    return np.round(1e3 * np.asarray(xy).reshape(-1, 2), 2).tolist()
