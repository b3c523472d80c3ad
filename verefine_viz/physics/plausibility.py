"""Could the object be there? Floating, sinking in, standing: from geometry, without stepping (docs/methods.md 7.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, QhullError

from verefine_viz.core.arrays import Float, finite, frozen, set_fields
from verefine_viz.core.geometry import apply, inverse
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.observation import Support
from verefine_viz.core.problem import Placed
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.core.settings import PhysicsSettings
from verefine_viz.core.surroundings import SUPPORT_ID, SupportSurface, unknown_number
from verefine_viz.physics.colliders import collider
from verefine_viz.physics.proximity import Surface, nearness
from verefine_viz.physics.simulator import checked_pose, plane_of
from verefine_viz.physics.stability import IMPOSSIBLE_M, TOUCHING_M, UPWARDS
from verefine_viz.physics.world import PLANE_FRICTION

Light = Literal["green", "amber", "red"]

NEAR_M = TOUCHING_M + IMPOSSIBLE_M
"""Neighbours further away than this do not count."""
BARELY_M = 0.003
"""A smaller margin of the centre of mass is reported."""
HEIGHT_SHARE, LEAN_DEG = 0.05, 2.5
"""Depth images of real frames measure upright objects as much lower than they are, and leaning by so much, so that
ground truth sinks into a plane that is right (docs/measured.md)."""
DOWN = np.array([0.0, 0.0, -1.0])
CONE_SIDES = 8
"""Sides of the pyramid inscribed in each friction cone; with 8 it loses at most 8 % of the friction."""
BALANCED = 1e-7
"""What forces and torques may leave of gravity, as a share of it."""
MOST_CONTACTS = 60
"""Contacts with neighbours that enter the equilibrium; more change nothing."""


@dataclass(frozen=True, eq=False)
class Plausibility:
    """What geometry says about a pose."""

    gap_mm: float
    """Distance to the support plane, or to a neighbour or surroundings within 7 mm that are nearer; 0 where it touches
    [mm]."""
    penetration_mm: float
    """Overlap that is the largest share of what is tolerated; 0 for none [mm]."""
    penetrates: int | None
    """instance_id of what it sinks into so deep, −1 for the support, less for unknown objects, None for none (below
    0.01 mm)."""
    tolerance_mm: float
    """A deeper overlap with that cannot be [mm]: 5 mm, and what short heights and a lean in the depth explain."""
    contact_points_cam: Float
    """(n, 3) where it touches [m]."""
    contact_normals_cam: Float
    """(n, 3) unit, pointing onto the object."""
    contact_others: NDArray[np.int64]
    """(n,) instance_id of what is touched; −1 is the support, less an unknown object."""
    polygon_cam: Float
    """(m, 3) corners of the support polygon, in the plane below it and in order [m]: the hull, seen from above, of the
    contacts that push upwards. Two corners: it stands on an edge; one: on a point; none: nothing carries it."""
    com_cam: Float
    """(3,) centre of mass [m]."""
    com_on_plane_cam: Float
    """(3,) the point of that plane below (or above) the centre of mass [m]."""
    margin_mm: float
    """Horizontal distance of the centre of mass to the polygon's edge, positive inside; −inf where nothing carries it
    [mm]."""
    is_stable: bool | None
    """Whether friction at the contacts can hold it still, or could if it leant less by what is tolerated; None where it
    sinks in so deep that they cannot tell."""
    light: Light
    """green: plausible; amber: within tolerance, or barely; red: cannot be."""
    sentence: str
    """The check in words."""

    def __post_init__(self) -> None:
        n = len(self.contact_others)
        set_fields(
            self,
            contact_points_cam=finite(self.contact_points_cam, "contact points", (n, 3)),
            contact_normals_cam=finite(self.contact_normals_cam, "contact normals", (n, 3)),
            contact_others=frozen(self.contact_others, "contact partners", (n,), np.int64),
            polygon_cam=finite(self.polygon_cam, "support polygon", (None, 3)),
            com_cam=finite(self.com_cam, "centre of mass", (3,)),
            com_on_plane_cam=finite(self.com_on_plane_cam, "centre of mass", (3,)),
        )

    def share(self, fall_m: float) -> float:
        """What a score has of it, p in [0, 1]: half for touching without sinking in, half for being stable.

        The first half falls linearly with the gap beyond 2 mm, or with the penetration beyond what is tolerated, to 0
        at ``fall_m`` more. After SporeAgent (Bauer et al., WACV 2022), whose agent is rewarded for poses that do not
        float, do not intersect and are stable; there each is yes or no.
        """
        beyond_m = max(self.gap_mm * 1e-3 - TOUCHING_M, (self.penetration_mm - self.tolerance_mm) * 1e-3)
        return 0.5 * min(1.0, max(0.0, 1.0 - beyond_m / fall_m)) + 0.5 * bool(self.is_stable)


def plausibility(
    moving: Placed,
    fixed: Sequence[Placed],
    support: Support,
    settings: PhysicsSettings | None = None,
    cache: Path | None = None,
    surface_of: Callable[[ObjectModel], Surface] = Surface,
    progress: ProgressToken = NEVER_CANCELLED,
    com_obj: Float | None = None,
) -> Plausibility:
    """Evaluates the pose of ``moving`` among ``fixed`` objects (taken as immovable) on the support plane, or in the
    surroundings that ``support`` has instead.

    Distances are between the meshes themselves, so no collision margin enters; friction and the collider whose centre
    of mass stands in for a mesh with holes are those of ``settings``.

    Args:
        moving: the object and the pose to evaluate.
        fixed: its neighbours; their order does not matter.
        support: plane and gravity.
        settings: the simulator's settings; defaults if None.
        cache: folder of colliders already built; by default in the user's cache folder.
        surface_of: makes the surface of a model; ``Surfaces()`` caches them.
        progress: asked where a collider has to be built.
        com_obj: :func:`centre_of_mass` of the object (3,), where that is known: it takes half of the time.

    Raises:
        ShapeError: a pose is not rigid, not finite or far away, or a model has no volume.
        Cancelled: through ``progress``.
    """
    settings = settings or PhysicsSettings()
    T_world_obj = support.T_world_cam @ checked_pose(moving)
    if com_obj is None:
        com_obj = centre_of_mass(moving.model, settings, cache, progress)
    com = apply(T_world_obj, com_obj[None])[0]

    vertices = apply(T_world_obj, _solid_vertices(moving.model))
    near, gaps_m, depths_m, tolerances_m = _nearby(
        moving.model, T_world_obj, vertices, fixed, support, settings.friction, surface_of
    )
    below = _below(com[:2], float(vertices[:, 2].min()), support)

    gap_m = min(gaps_m.values())
    deepest = max(depths_m, key=lambda other: depths_m[other] / tolerances_m[other])
    depth_m, tolerance_m = depths_m[deepest], tolerances_m[deepest]
    # A pose that floats a little is evaluated as if the gap were closed; one that floats far touches nothing.
    reach_m = gap_m + TOUCHING_M if gap_m <= IMPOSSIBLE_M else -1.0
    points, normals, partners, friction = _contacts(near, reach_m)
    carrying = points[normals[:, 2] > UPWARDS, :2]
    polygon_xy = carrying[_hull_indices(carrying)]
    margin_m = _margin_m(polygon_xy, com[:2])
    is_stable, leans = None, False
    if depth_m <= tolerance_m:
        is_stable = holds(points, normals, friction, com, DOWN)
        if not is_stable and gap_m <= IMPOSSIBLE_M:
            on_base = _contacts(near, reach_m + 2 * _rise_m(vertices))
            is_stable = leans = holds(on_base[0], on_base[1], on_base[3], com, DOWN)

    light, sentence = _rating(gap_m, depth_m, tolerance_m, _named(deepest, support), margin_m, is_stable, leans)
    T_cam_world = inverse(support.T_world_cam)
    R_cam_world = T_cam_world[:3, :3]
    return Plausibility(
        gap_mm=gap_m * 1e3,
        penetration_mm=depth_m * 1e3,
        penetrates=deepest if depth_m > 1e-5 else None,
        tolerance_mm=tolerance_m * 1e3,
        contact_points_cam=apply(T_cam_world, points),
        contact_normals_cam=normals @ R_cam_world.T,
        contact_others=partners,
        polygon_cam=apply(T_cam_world, below.lifted(polygon_xy)),
        com_cam=apply(T_cam_world, com[None])[0],
        com_on_plane_cam=apply(T_cam_world, below.lifted(com[None, :2]))[0],
        margin_mm=margin_m * 1e3,
        is_stable=is_stable,
        light=light,
        sentence=sentence,
    )


class _Near(NamedTuple):
    """Points of the object, or of a neighbour, between which contact is possible; world frame."""

    points: Float
    """(n, 3) [m]."""
    normals: Float
    """(n, 3) unit, onto the object."""
    distances_m: Float
    """(n,) negative inside."""
    instance_id: int
    """The neighbour."""
    friction: float


def _nearby(
    model: ObjectModel,
    T_world_obj: Float,
    vertices: Float,
    fixed: Sequence[Placed],
    support: Support,
    friction: float,
    surface_of: Callable[[ObjectModel], Surface],
) -> tuple[list[_Near], dict[int, float], dict[int, float], dict[int, float]]:
    """What is near the object, the base of the support first, and by instance the gap to it, how deep the object sinks
    in and how deep it may [m].
    """
    around = support.surroundings
    base = around.base if around is not None else plane_of(support)
    # The plane: its distance to a mesh is a vertex's.
    heights_m = base.heights(vertices)
    gaps_m = {SUPPORT_ID: max(float(heights_m.min()), 0.0)}
    depths_m = {SUPPORT_ID: max(-float(heights_m.min()), 0.0)}
    own_m = _tolerated_m(vertices)
    tolerances_m = {SUPPORT_ID: own_m}
    upwards = np.broadcast_to(base.normal_world, vertices.shape)
    near = [_Near(vertices, upwards, heights_m, SUPPORT_ID, friction * PLANE_FRICTION)]

    others = [
        (placed.instance_id, placed.model, support.T_world_cam @ checked_pose(placed))
        for placed in sorted(fixed, key=lambda placed: placed.instance_id)
    ]
    still = [(instance_id, body, np.eye(4)) for instance_id, body in around.bodies] if around is not None else []
    surface: Surface | None = None
    for own, other, T_world_other in (*others, *still):
        others_vertices = apply(T_world_other, _solid_vertices(other))
        if _are_apart(vertices, others_vertices):
            continue
        surface = surface or surface_of(model)
        there = nearness(surface, T_world_obj, surface_of(other), T_world_other, NEAR_M)
        gaps_m[own] = min(gaps_m.get(own, np.inf), there.gap_m)
        depths_m[own] = max(depths_m.get(own, 0.0), there.penetration_m)
        # Short heights let what stands on another sink into it, whichever of the two that is, and not sideways. What is
        # no object is as it was measured.
        more_m = (max(own_m, _tolerated_m(others_vertices)) if own >= 0 else own_m) - IMPOSSIBLE_M
        tolerances_m[own] = IMPOSSIBLE_M + more_m * there.upright
        friction_there = PLANE_FRICTION if own == SUPPORT_ID else friction
        near.append(_Near(there.points, there.normals, there.distances_m, own, friction * friction_there))
    return near, gaps_m, depths_m, tolerances_m


def _tolerated_m(vertices: Float) -> float:
    """How deep an object with these vertices (n, 3), world frame, may sink in [m].

    Neither short heights nor a lean lift it off, so that no more than ``IMPOSSIBLE_M`` of a gap is tolerated.
    """
    return IMPOSSIBLE_M + HEIGHT_SHARE * float(np.ptp(vertices[:, 2])) + _rise_m(vertices)


def _rise_m(vertices: Float) -> float:
    """How much lower the edge of an object is than its middle when it leans by ``LEAN_DEG`` [m]."""
    middle = (vertices[:, :2].min(axis=0) + vertices[:, :2].max(axis=0)) / 2
    return float(np.linalg.norm(vertices[:, :2] - middle, axis=1).max() * np.sin(np.radians(LEAN_DEG)))


def centre_of_mass(
    model: ObjectModel,
    settings: PhysicsSettings,
    cache: Path | None = None,
    progress: ProgressToken = NEVER_CANCELLED,
) -> Float:
    """Centre of mass (3,) of a model, in its frame [m]; the arguments are those of :func:`plausibility`.

    Raises:
        ShapeError: the model has no volume.
        Cancelled: through ``progress``.
    """
    solid = collider(model, "hull", cache, progress)
    if solid.mass_from == "parts":  # A closed mesh has its own centre of mass, however its collider is made.
        solid = collider(model, settings.collider, cache, progress)
    return solid.com_obj


def holds(points: Float, normals: Float, friction: Float, com: Float, gravity_direction: Float) -> bool:
    """Whether contact forces inside friction cones can balance gravity at the centre of mass: the edges of the cones
    in shares of at least 0 (least squares, Lawson and Hanson 1974).

    Args:
        points: contact points (n, 3) [m].
        normals: (n, 3) unit normals pointing onto the object.
        friction: (n,) coefficients μ of the contacts.
        com: centre of mass (3,) [m].
        gravity_direction: (3,) unit, down.
    """
    if len(points) == 0:
        return False
    arms = points - com
    reach = max(float(np.linalg.norm(arms, axis=1).max()), 1e-9)
    edges = _cone_edges(normals, friction)
    torques = np.cross(arms[:, None, :] / reach, edges)
    balance = np.concatenate([edges, torques], axis=2).reshape(-1, 6).T
    weight = np.concatenate([-gravity_direction, np.zeros(3)])
    try:
        return bool(nnls(balance, weight)[1] < BALANCED)
    except RuntimeError:  # It came to no end, which accuses no pose.
        return True


def _cone_edges(normals: Float, friction: Float) -> Float:
    """Edges (n, CONE_SIDES, 3) of the pyramids inscribed in the friction cones."""
    smallest = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    u = np.cross(normals, smallest)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normals, u)
    angles = np.arange(CONE_SIDES) * (2 * np.pi / CONE_SIDES)
    around = np.cos(angles)[:, None] * u[:, None, :] + np.sin(angles)[:, None] * v[:, None, :]
    return normals[:, None, :] + friction[:, None, None] * around


def _solid_vertices(model: ObjectModel) -> Float:
    """Vertices (n, 3) that belong to a face, object frame [m]."""
    return model.vertices[np.unique(model.faces)]


def _below(xy: Float, lowest_m: float, support: Support) -> SupportSurface:
    """The plane that what stands at ``xy`` (2,) is shown to stand on: that of the surfaces there nearest to its lowest
    point; the support plane where there is none.
    """
    there = [s for s in support.surroundings.supporting if s.reaches(xy[None])[0]] if support.surroundings else []
    return min(there or [plane_of(support)], key=lambda s: abs(float(s.lifted(xy[None])[0, 2]) - lowest_m))


def _are_apart(a: Float, b: Float) -> bool:
    """Whether the boxes around two clouds (n, 3) are too far apart for a contact or a small gap."""
    between_m = np.maximum(a.min(axis=0) - b.max(axis=0), b.min(axis=0) - a.max(axis=0))
    return float(between_m.max()) > NEAR_M


def _contacts(near: Sequence[_Near], reach_m: float) -> tuple[Float, Float, NDArray[np.int64], Float]:
    """Points, normals, partners and friction of what is within ``reach_m``, thinned out."""
    points, normals, others, friction = [np.zeros((0, 3))], [np.zeros((0, 3))], [], []
    for k, (p, n, distance_m, other, mu) in enumerate(near):
        touching = np.flatnonzero(distance_m <= reach_m)
        if k == 0:  # The plane, with one normal: the corners carry as much as all.
            touching = touching[_hull_indices(p[touching, :2])]
        elif len(touching) > MOST_CONTACTS:
            every = np.linspace(0, len(touching) - 1, MOST_CONTACTS).astype(int)
            touching = touching[np.union1d(every, _hull_indices(p[touching, :2]))]
        points.append(p[touching])
        normals.append(n[touching])
        others += [other] * len(touching)
        friction += [mu] * len(touching)
    return np.vstack(points), np.vstack(normals), np.array(others, dtype=np.int64), np.array(friction)


def _hull_indices(xy: Float) -> NDArray[np.intp]:
    """Indices of the corners of the convex hull of points (n, 2), in order; the ends if they lie on a line."""
    if len(xy) == 0:
        return np.zeros(0, dtype=np.intp)
    direction = np.linalg.svd(xy - xy.mean(axis=0), full_matrices=False)[2][0]
    along = xy @ direction
    across = np.ptp(xy @ np.array([-direction[1], direction[0]]))
    if across > 1e-6:
        try:
            return ConvexHull(xy).vertices.astype(np.intp)
        except QhullError:
            pass
    ends = [int(along.argmin()), int(along.argmax())]
    return np.array(ends if np.ptp(along) > 1e-6 else ends[:1], dtype=np.intp)


def _margin_m(polygon_xy: Float, xy: Float) -> float:
    """Distance (positive inside) of a point to the edge of a convex polygon with 0, 1, 2 or more corners [m]."""
    if len(polygon_xy) == 0:
        return -float("inf")
    starts, ends = polygon_xy, np.roll(polygon_xy, -1, axis=0)
    edges = ends - starts
    lengths2 = np.maximum((edges**2).sum(axis=1), 1e-18)
    along = np.clip(((xy - starts) * edges).sum(axis=1) / lengths2, 0, 1)
    distance_m = float(np.linalg.norm(xy - starts - along[:, None] * edges, axis=1).min())
    sides = edges[:, 0] * (xy - starts)[:, 1] - edges[:, 1] * (xy - starts)[:, 0]
    inside = len(polygon_xy) > 2 and (bool((sides >= 0).all()) or bool((sides <= 0).all()))
    return distance_m if inside else -distance_m


def _named(instance_id: int, support: Support) -> str:
    if instance_id == SUPPORT_ID:
        return "the support plane" if support.surroundings is None else "the support"
    number = unknown_number(instance_id)
    return f"instance {instance_id}" if number is None else f"unknown object {number}"


def _rating(
    gap_m: float,
    depth_m: float,
    tolerance_m: float,
    into: str,
    margin_m: float,
    is_stable: bool | None,
    leans: bool,
) -> tuple[Light, str]:
    """What is worst about the pose decides; ``leans``: it is stable if the lean that is tolerated is taken away."""
    sinks = f"Sinks {depth_m * 1e3:.1f} mm into {into}."
    floats = f"Floats: {gap_m * 1e3:.1f} mm to the nearest surface."
    if depth_m > tolerance_m:
        return "red", sinks
    if gap_m > IMPOSSIBLE_M:
        return "red", floats
    if not is_stable and margin_m == -np.inf:
        return "red", "Would fall: nothing carries it from below."
    if not is_stable and margin_m < 0:
        return "red", f"Would tip: the centre of mass is {-margin_m * 1e3:.1f} mm outside its support."
    if not is_stable:
        return "red", "Would slip or tip: friction at its contacts cannot hold it."
    if depth_m > TOUCHING_M:
        return "amber", sinks
    if gap_m > TOUCHING_M:
        return "amber", floats
    if leans:
        return "amber", f"Touches at an edge: it would stand if it leant less, by up to {LEAN_DEG}°."
    if margin_m < 0:
        return "green", "Leans: it is held by its contacts together, with the centre of mass outside what carries it."
    if margin_m < BARELY_M:
        return "amber", f"Barely stands: the centre of mass is {margin_m * 1e3:.1f} mm from the edge of its support."
    return "green", f"Stands: the centre of mass is {margin_m * 1e3:.1f} mm inside its support."
