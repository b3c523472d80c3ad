"""What Bullet collides with: convex parts, centre of mass and inertia of a model.

Bullet's moving bodies must be convex or made of convex parts. One hull fills bowls and mugs; a decomposition keeps them
hollow (docs/methods.md 1.8.24). Decomposing takes seconds, so the parts are cached on disk by the hash of the mesh.
"""

from __future__ import annotations

import contextlib
import hashlib
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import Literal

import numpy as np
import platformdirs
import trimesh
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, KDTree, QhullError

from verefine_viz.core.array_cache import Arrays, cached, read
from verefine_viz.core.arrays import Float, finite, set_fields
from verefine_viz.core.decimation import decimated
from verefine_viz.core.errors import ShapeError
from verefine_viz.core.geometry import as_rigid, inverse, transform
from verefine_viz.core.model import ObjectModel
from verefine_viz.core.progress_token import NEVER_CANCELLED, ProgressToken
from verefine_viz.physics.decomposition import LIMIT_S, PARTS_OF, TookTooLong, decomposed

ColliderKind = Literal["decomposition", "hull"]

HULL_TOLERANCE = 0.001
"""A part may be this much smaller than the exact hull, as a share of the model's diameter: fewer vertices, faster."""
CONVEX_ENOUGH = 0.05
"""A model without deeper pockets in its hull [share of the diameter] is its hull: no decomposition."""
FULL_ENOUGH = 0.06
"""A solid that lacks no more than this share of its hull's volume is not decomposed either: its pockets are narrow,
however deep. The foam brick of YCB-Video lacks 5.7 % in three holes as wide as a finger; CoACD took 11 s to make 16
parts of it."""
DECOMPOSED_FACES = 1000
"""Most faces that the decomposition works on; more cost minutes and change little."""
BEYOND, SHORT = 0.05, 0.1
"""How much further than the mesh, and how much less far, a collider may reach in any direction [share of the diameter].
Those of YCB-Video and LINEMOD reach at most 0.018 further and 0.013 less far."""
BOX_MARGIN_M = 0.002
"""How much wider Bullet's bounding box is on each side, whatever margin a body gets later [m]."""
FORMAT = 5
"""Part of the cache's file names; raise it when the way colliders are built changes."""


@dataclass(frozen=True, eq=False)
class Collider:
    """The simulated shape of a model."""

    parts: tuple[Float, ...]
    """Vertices (n, 3) of each convex part, object frame [m]."""
    T_obj_com: Float
    """(4, 4) centre of mass and principal axes of inertia [m]."""
    inertia_m2: Float
    """(3,) principal moments of inertia per kilogram [m²]."""
    mass_from: Literal["mesh", "parts", "box"]
    """Whether centre of mass and inertia come from the closed mesh, or from the parts because the mesh has holes; box:
    the inertia from the bounding box."""
    deviation_m: float
    """How far the surfaces of collider and mesh are from each other, at worst [m]: with a hull, the depth of the bowl
    that physics takes for solid. Sampled, so a good fit reads as about 1 % of the diameter."""
    took_too_long: bool = False
    """Whether it is the hull only because the decomposition takes more than ``decomposition.LIMIT_S``."""

    def __post_init__(self) -> None:
        set_fields(
            self,
            parts=tuple(finite(p, "collider part", (None, 3)) for p in self.parts),
            T_obj_com=as_rigid(self.T_obj_com, "T_obj_com"),
            inertia_m2=finite(self.inertia_m2, "inertia", (3,)),
        )

    @cached_property
    def T_com_obj(self) -> Float:
        """The inverse of ``T_obj_com``."""
        return inverse(self.T_obj_com)

    @property
    def com_obj(self) -> Float:
        """Centre of mass (3,) in the object frame [m]."""
        return self.T_obj_com[:3, 3]

    @property
    def note(self) -> str:
        """Note for the user where the collider is not as asked for; else empty."""
        if not self.took_too_long:
            return ""
        return (
            f"physics takes it for its convex hull, {1e3 * self.deviation_m:.0f} mm from the mesh at worst, because "
            f"taking it apart into convex parts takes more than {LIMIT_S} s of computing; "
            "a closed mesh with fewer faces is faster"
        )


def collider(
    model: ObjectModel, kind: ColliderKind, cache: Path | None = None, progress: ProgressToken = NEVER_CANCELLED
) -> Collider:
    """The collider of ``model``, from the cache on disk or built now (a hull: milliseconds, a decomposition: seconds).

    Where the decomposition takes too long, the hull is cached in place of the parts, with a note. Trying again at each
    start would cost that time again, and could give the later frames of a resumed run another collider than the earlier
    ones.

    Args:
        model: the model.
        kind: "decomposition" or "hull".
        cache: folder of built colliders; by default in the user's cache folder.
        progress: checked while the collider is built.

    Raises:
        ShapeError: the mesh has no volume (flat, a line, a point), so no solid can be made of it; or CoACD fails on it.
        Cancelled: through ``progress``; nothing is cached.
    """
    return cached(
        _file(model, kind, cache),
        lambda: build(model, kind, progress),
        _unpacked,
        _packed,
        progress.checkpoint,
        preparing=f"Preparing the collider of {model.name} for physics; cached once it is made.",
        waiting=f"Waiting for {PARTS_OF} {model.name}, which another process is preparing.",
        is_sound=lambda known: lies_on(known.parts, model),
    )


def known_collider(model: ObjectModel, kind: ColliderKind, cache: Path | None = None) -> Collider | None:
    """The collider of ``model`` from the cache; None = it is not there. Arguments as in :func:`collider`."""
    known = read(_file(model, kind, cache), _unpacked)
    return known if known is not None and lies_on(known.parts, model) else None


def _file(model: ObjectModel, kind: ColliderKind, cache: Path | None) -> Path:
    folder = platformdirs.user_cache_path("verefine-viz") / "colliders" if cache is None else cache
    return folder / f"{model.mesh_hash}-{kind}-{FORMAT}-{_built_with()}.npz"


@lru_cache(maxsize=1)
def _built_with() -> str:
    """Versions of the libraries that the result depends on: another version may give other parts."""
    names = ("coacd", "fast-simplification", "numpy", "scipy", "trimesh")
    return hashlib.sha256(" ".join(version(name) for name in names).encode()).hexdigest()[:8]


def build(model: ObjectModel, kind: ColliderKind, progress: ProgressToken = NEVER_CANCELLED) -> Collider:
    """The collider of ``model``, without the cache; see :func:`collider`."""
    name = f"object {model.obj_id} ({model.name})"
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=True)
    try:
        hull = reduced_hull(np.asarray(mesh.vertices), HULL_TOLERANCE * model.diameter_m)
        exact = ConvexHull(mesh.vertices)
    except QhullError:
        raise ShapeError(
            f"{name} has no volume; a solid mesh is needed for physics, or physics.enabled = false"
        ) from None
    if exact.volume < 1e-6 * model.diameter_m**3:
        raise ShapeError(f"{name} is flat; a solid mesh is needed for physics, or physics.enabled = false")
    surface = _surface(mesh)
    parts, took_too_long = [hull], False
    deviation_m = deviation(parts, surface)
    pockets = deviation_m > CONVEX_ENOUGH * model.diameter_m and not _fills(mesh, float(exact.volume))
    if kind == "decomposition" and pockets:
        try:
            parts = _decomposed(name, mesh, model.diameter_m, progress) or parts
        except TookTooLong:
            took_too_long = True
        if not lies_on(parts, model):
            raise ShapeError(
                f"{name} cannot be taken apart into convex parts (they do not lie on its mesh); "
                'set physics.collider = "hull"'
            )
        deviation_m = deviation(parts, surface)
    return Collider(tuple(parts), *_mass_properties(mesh, parts), deviation_m, took_too_long)


def solid_of(model: ObjectModel, parts: list[Float]) -> Collider:
    """Return the collider of a model that has these convex parts, each (n, 3) vertices [m]."""
    mesh = trimesh.Trimesh(model.vertices, model.faces, process=True)
    return Collider(tuple(parts), *_mass_properties(mesh, parts), deviation(parts, _surface(mesh)))


def boxed(solid: Collider) -> Collider:
    """``solid`` with the moments of its bounding box along the object's axes, as Bullet computes them, about its own
    centre of mass.
    """
    squares = (np.ptp(np.vstack(solid.parts), axis=0) + 2 * BOX_MARGIN_M) ** 2
    T_obj_com = transform(np.eye(3), solid.com_obj)
    return replace(solid, T_obj_com=T_obj_com, inertia_m2=(squares.sum() - squares) / 12, mass_from="box")


def lies_on(parts: list[Float] | tuple[Float, ...], model: ObjectModel) -> bool:
    """Whether convex ``parts``, each (n, 3) vertices [m], end where the mesh of ``model`` ends, seen from any side."""
    directions = _directions(64).T
    mesh_m = (model.vertices[np.unique(model.faces)] @ directions).max(axis=0)
    beyond_m = (np.vstack(parts) @ directions).max(axis=0) - mesh_m
    return bool(beyond_m.max() < BEYOND * model.diameter_m and beyond_m.min() > -SHORT * model.diameter_m)


def _surface(mesh: trimesh.Trimesh) -> Float:
    """Dense points (N, 3) of a mesh [m]."""
    return np.vstack([mesh.vertices, trimesh.sample.sample_surface(mesh, 20_000, seed=0)[0]])


def _fills(mesh: trimesh.Trimesh, hull_m3: float) -> bool:
    """Whether a mesh fills its hull but for ``FULL_ENOUGH``.

    Only a closed, consistently wound mesh in one part has a reliable volume: where parts overlap, the overlap counts
    twice.
    """
    has_volume = bool(mesh.is_volume) and mesh.body_count == 1
    return has_volume and abs(float(mesh.volume) / hull_m3 - 1) <= FULL_ENOUGH


def reduced_hull(points: Float, tolerance_m: float) -> Float:
    """Vertices (n, 3) of a convex hull of ``points`` (N, 3) that leaves none out by more than ``tolerance_m``.

    Raises:
        QhullError: the points lie in one plane.
    """
    full = points[ConvexHull(points).vertices]
    chosen = np.unique(np.argmax(full @ _directions(64).T, axis=0))
    while True:
        hull = ConvexHull(full[chosen])
        outside_m = full @ hull.equations[:, :3].T + hull.equations[:, 3]
        worst = np.unique(np.argmax(outside_m, axis=0)[outside_m.max(axis=0) > tolerance_m])
        if len(worst) == 0:
            return full[chosen][hull.vertices]
        chosen = np.union1d(chosen, worst)


def signed_distance(parts: list[Float] | tuple[Float, ...], points: Float) -> Float:
    """Lower bound (N,) of the distance of ``points`` to the union of convex ``parts`` [m]; negative inside.

    Exact in front of faces and within a single part.
    """
    best = np.full(len(points), np.inf)
    for part in parts:
        planes = ConvexHull(part).equations
        np.minimum(best, (points @ planes[:, :3].T + planes[:, 3]).max(axis=1), out=best)
    return best


def deviation(parts: list[Float] | tuple[Float, ...], surface: Float) -> float:
    """How far the collider is from dense points (N, 3) of the mesh's surface, at worst and in both directions [m]."""
    outside_m = max(0.0, float(signed_distance(parts, surface[:: 1 + len(surface) // 5000]).max()))
    tree = KDTree(surface)
    for k, part in enumerate(parts):
        samples = trimesh.sample.sample_surface(trimesh.convex.convex_hull(part), 2000 // len(parts), seed=0)[0]
        others = [other for j, other in enumerate(parts) if j != k]
        if others:  # Faces where parts meet are not on the surface.
            samples = samples[signed_distance(others, samples) > 0.005 * np.linalg.norm(np.ptp(surface, axis=0))]
        if len(samples):
            outside_m = max(outside_m, float(tree.query(samples)[0].max()))
    return outside_m


def _directions(n: int) -> Float:
    """``n`` directions spread evenly over the sphere (golden spiral), and the six axes."""
    i = np.arange(n) + 0.5
    z, angle = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
    r = np.sqrt(1 - z**2)
    return np.vstack([np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1), np.eye(3), -np.eye(3)])


def _decomposed(name: str, mesh: trimesh.Trimesh, diameter_m: float, progress: ProgressToken) -> list[Float]:
    """Convex parts of a hollow mesh; none if the decomposition gives nothing solid."""
    if len(mesh.faces) > DECOMPOSED_FACES:
        # Not trimesh's call of the same library, which is not safe with other threads.
        mesh = trimesh.Trimesh(*decimated(np.asarray(mesh.vertices), np.asarray(mesh.faces), DECOMPOSED_FACES))
    parts = []
    for part in decomposed(name, np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int32), progress):
        with contextlib.suppress(QhullError):  # A sliver without volume carries nothing.
            parts.append(reduced_hull(part, HULL_TOLERANCE * diameter_m))
    return parts


def _mass_properties(mesh: trimesh.Trimesh, parts: list[Float]) -> tuple[Float, Float, Literal["mesh", "parts"]]:
    """``T_obj_com``, principal moments per kilogram [m²] and their source, at uniform density."""
    closed = bool(mesh.is_volume)
    solids = [mesh] if closed else [trimesh.convex.convex_hull(part) for part in parts]
    volumes = np.array([s.volume for s in solids])
    centers = np.array([s.center_mass for s in solids])
    com = volumes @ centers / volumes.sum()
    inertia = np.zeros((3, 3))
    for solid, volume, center in zip(solids, volumes, centers, strict=True):
        d = center - com
        inertia += solid.moment_inertia + volume * (d @ d * np.eye(3) - np.outer(d, d))
    moments, axes = np.linalg.eigh(inertia / volumes.sum())
    if np.linalg.det(axes) < 0:
        axes[:, 2] *= -1
    return transform(axes, com), moments, "mesh" if closed else "parts"


def _unpacked(arrays: Arrays) -> Collider:
    return Collider(
        tuple(np.split(arrays["vertices"], arrays["splits"])),
        arrays["T_obj_com"],
        arrays["inertia_m2"],
        "mesh" if arrays["closed"] else "parts",
        float(arrays["deviation_m"]),
        "took_too_long" in arrays and bool(arrays["took_too_long"]),
    )


def _packed(built: Collider) -> dict[str, ArrayLike]:
    return {
        "vertices": np.vstack(built.parts),
        "splits": np.cumsum([len(p) for p in built.parts])[:-1],
        "T_obj_com": built.T_obj_com,
        "inertia_m2": built.inertia_m2,
        "deviation_m": built.deviation_m,
        "closed": built.mass_from == "mesh",
        "took_too_long": built.took_too_long,
    }
