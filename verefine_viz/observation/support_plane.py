"""The plane that carries the objects, and which way is up.

Several planes are taken from the background near the objects by RANSAC, the largest first; the one that carries the
objects (they lie above it and reach down to it) is refined by least squares. docs/methods.md 7.1 describes the first
steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.camera import Camera
from verefine_viz.core.errors import NoSupportError
from verefine_viz.core.geometry import transform
from verefine_viz.core.kernels import kernel
from verefine_viz.core.observation import ON_PLANE_M, GravitySource, Support

Gravity = Literal["plane", "world"] | tuple[float, float, float]

MAX_PLANES = 4
"""Most planes tried: table, wall, shelf, box."""
RANSAC_POINTS = 4000
"""Points of the background that RANSAC sees."""
RANSAC_TRIALS = 400
"""Triples tried per plane; a plane with 30 % of the points is missed once in 50 000 times."""
MIN_SHARE = 0.10
"""Share of the background near the objects that a plane must hold."""
MIN_POINTS = 200
"""Fewest points of background to look for a plane in."""
MAX_TILT_RAD = np.radians(30.0)
"""Angle between a plane's normal and a known "up" beyond which nothing would stay on it."""
ROUNDS = 4
"""Number of fits at each tolerance, each to the points near the previous plane."""
NARROWER = (1.0, 0.5, 0.25)
"""Shares of the tolerance, one after another: a keyboard on the table, or the table's bent edge, lies within the full
tolerance and tilts the plane. In five YCB-Video frames of one table the ground truth of a mug leans by 2.6° against
this plane, by 5.7° against that of the full tolerance."""


@dataclass(frozen=True)
class Plane:
    """A plane in the camera frame."""

    normal: Float
    """(3,) unit, towards the camera."""
    offset_m: float
    """``normal · p + offset_m`` is the height of p above the plane [m]."""

    @staticmethod
    def towards_camera(normal: Float, offset_m: float) -> Plane:
        """The plane ``normal · p + offset_m = 0``, for a normal (3,) of any length and either sign."""
        length = float(np.linalg.norm(normal))
        sign = 1.0 if offset_m >= 0 else -1.0  # the camera is the origin, whose height is the offset
        return Plane(sign * normal / length, sign * offset_m / length)

    def heights(self, points: Float) -> Float:
        """(n,) of points (n, 3) [m]."""
        return points @ self.normal + self.offset_m

    def touches(self, points: Float, tolerance_m: float) -> NDArray[np.bool_]:
        """(n,) which of the points (n, 3) lie on it."""
        return np.abs(self.heights(points)) < tolerance_m


def fitted(plane: Plane, points: Float, tolerance_m: float) -> Plane:
    """The plane of the points (n, 3) that lie within ``tolerance_m`` of ``plane``, which at least three do.

    Fitted by least squares: first to all of them, then to ever closer ones.
    """
    most = 0
    for share in np.repeat(NARROWER, ROUNDS):
        n, centre, scatter = _moments(points, plane.normal, plane.offset_m, share * tolerance_m)
        most = max(most, n)
        if 2 * n < most:
            break  # The noise is wider than the deviations to be excluded.
        normal = np.linalg.eigh(scatter)[1][:, 0]
        plane = Plane.towards_camera(normal, float(-normal @ centre))
    return plane


@kernel()
def _moments(points: Float, normal: Float, offset_m: float, tolerance_m: float) -> tuple[int, Float, Float]:
    """Number, mean (3,) and scatter (3, 3) of the points on the plane; around the mean, as sums of squares would
    cancel.

    Compiled, as it takes all pixels of a frame.
    """
    a, b, c = normal[0], normal[1], normal[2]
    x, y, z, n = 0.0, 0.0, 0.0, 0
    for k in range(len(points)):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        if abs(px * a + py * b + pz * c + offset_m) < tolerance_m:
            x, y, z, n = x + px, y + py, z + pz, n + 1
    x, y, z = x / max(n, 1), y / max(n, 1), z / max(n, 1)
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(len(points)):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        if abs(px * a + py * b + pz * c + offset_m) < tolerance_m:
            dx, dy, dz = px - x, py - y, pz - z
            xx, xy, xz = xx + dx * dx, xy + dx * dy, xz + dx * dz
            yy, yz, zz = yy + dy * dy, yz + dy * dz, zz + dz * dz
    return n, np.array([x, y, z]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def find_support(
    depth_m: NDArray[np.floating],
    camera: Camera,
    object_mask: Mask,
    gravity: Gravity,
    R_world_cam: Float | None,
    seed: int,
) -> Support:
    """The support plane of one frame; the world frame has +z against gravity and its origin on the plane.

    The origin is the mean of the plane's points near the objects. Where gravity is taken from the plane or from a
    vector, the world's y axis points away from the camera.

    Args:
        depth_m: z, (H, W) [m]; 0 where nothing was measured.
        camera: intrinsics.
        object_mask: (H, W) pixels of all objects.
        gravity: "plane" (the plane's normal is up), "world" (from ``R_world_cam``), or the direction of gravity in
            the camera frame (an IMU's reading, of any length).
        R_world_cam: (3, 3) camera to world, world z up; needed for "world".
        seed: of the plane search.

    Raises:
        NoSupportError: no plane carries the objects, or gravity is unknown.
    """
    up_cam = _known_up(gravity, R_world_cam)
    depth = np.asarray(depth_m, dtype=np.float64)
    points = camera.back_project(depth)
    valid = depth > 0
    objects = points[valid & object_mask]
    background = points.reshape(-1, 3).take(np.flatnonzero(valid & ~object_mask), axis=0)
    near = _near(background, objects)
    plane = _carrying_plane(near, objects, up_cam, seed)
    plane = fitted(plane, near, ON_PLANE_M)
    inliers = near.take(np.flatnonzero(plane.touches(near, ON_PLANE_M)), axis=0)
    R_world_cam_used = _world_rotation(plane.normal, gravity, R_world_cam, up_cam)
    origin_cam = inliers.mean(axis=0)
    origin_cam = origin_cam - plane.heights(origin_cam) * plane.normal
    source: GravitySource = gravity if gravity in ("plane", "world") else "given"
    share = float(plane.touches(background, ON_PLANE_M).mean())
    rms_m = float(np.sqrt(np.mean(plane.heights(inliers) ** 2)))
    T_world_cam = transform(R_world_cam_used, -R_world_cam_used @ origin_cam)
    normal_world = R_world_cam_used @ plane.normal
    return Support(T_world_cam, normal_world, source, share, rms_m)


def _known_up(gravity: Gravity, R_world_cam: Float | None) -> Float | None:
    """The unit vector against gravity in the camera frame, or None where it is the plane's normal."""
    if gravity == "plane":
        return None
    if gravity == "world":
        if R_world_cam is None:
            raise NoSupportError(
                'gravity = "world" needs the camera\'s rotation (cam_R_w2c), which this frame does not have; '
                'set gravity = "plane" or give the vector'
            )
        return np.asarray(R_world_cam, dtype=np.float64)[2]
    down = np.asarray(gravity, dtype=np.float64)
    length = float(np.linalg.norm(down))
    if down.shape != (3,) or not np.isfinite(length) or length == 0.0:
        raise NoSupportError(f"gravity = {gravity!r} is no direction; expected three finite numbers, not all zero")
    return -down / length


def _near(background: Float, objects: Float) -> Float:
    """The background no farther away than the objects (mean of their depth plus one standard deviation)."""
    if len(objects) == 0:
        return background
    z = objects[:, 2]
    return background.take(np.flatnonzero(background[:, 2] < z.mean() + max(float(z.std()), 0.05)), axis=0)


def _carrying_plane(near: Float, objects: Float, up_cam: Float | None, seed: int) -> Plane:
    """The plane of the background that carries the objects."""
    if len(near) < MIN_POINTS:
        raise NoSupportError(
            f"no support plane: {len(near)} background pixels with depth near the objects, at least {MIN_POINTS} are "
            "needed; physics is off for this frame"
        )
    # A second to import: later than the page.
    import open3d as o3d

    rng = np.random.default_rng(seed)
    sample = near[np.sort(rng.choice(len(near), size=min(RANSAC_POINTS, len(near)), replace=False))]
    n_sample = len(sample)
    best: Plane | None = None
    best_worth = 0.0
    largest_share = 0.0
    most_carried, tilt_rad = 0.0, 0.0
    # Open3D's generator is global: seeded right before each use, the answer depends on the seed alone.
    for _ in range(MAX_PLANES):
        if len(sample) < max(3, MIN_SHARE * n_sample, best_worth * n_sample):
            break  # No plane in the remaining points can be worth more than the best so far.
        o3d.utility.random.seed(int(rng.integers(2**31)))
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(sample))
        # Probability 1 runs every trial: an early stop would depend on the timing of threads.
        coefficients, inlier_idx = cloud.segment_plane(ON_PLANE_M, 3, RANSAC_TRIALS, 1.0)
        plane = Plane.towards_camera(np.array(coefficients[:3]), float(coefficients[3]))
        share = len(inlier_idx) / n_sample
        largest_share = max(largest_share, share)
        carried, plane_tilt_rad = share * _carries(plane, objects), _tilt_rad(plane, up_cam)
        worth = carried if plane_tilt_rad <= MAX_TILT_RAD else 0.0
        if share >= MIN_SHARE and worth > best_worth:
            best, best_worth = plane, worth
        if share >= MIN_SHARE and carried > most_carried:
            most_carried, tilt_rad = carried, plane_tilt_rad
        sample = np.delete(sample, inlier_idx, axis=0)
    if best is None and most_carried > 0:
        reverse = "; reverse it (an accelerometer at rest reads upwards)" if tilt_rad > np.pi - MAX_TILT_RAD else ""
        raise NoSupportError(
            f"no support plane: the plane that carries the objects is tilted by {np.degrees(tilt_rad):.0f}° against "
            f"the gravity that was given, expected at most {np.degrees(MAX_TILT_RAD):.0f}°{reverse}; physics is off "
            "for this frame"
        )
    if best is None:
        raise NoSupportError(
            f"no support plane: the largest plane holds {largest_share:.0%} of the background near the objects and "
            f"none of at least {MIN_SHARE:.0%} carries them; physics is off for this frame"
        )
    return best


def _tilt_rad(plane: Plane, up_cam: Float | None) -> float:
    return 0.0 if up_cam is None else float(np.arccos(np.clip(plane.normal @ up_cam, -1.0, 1.0)))


def _carries(plane: Plane, objects: Float) -> float:
    """How well the objects stand on the plane, in [0, 1]: share of their points above it, less where all hover."""
    if len(objects) == 0:
        return 1.0
    heights = plane.heights(objects)
    above = float(np.mean(heights > -ON_PLANE_M))
    if above < 0.8:
        return 0.0
    gap_m = max(0.0, float(np.quantile(heights, 0.02)) - 2 * ON_PLANE_M)
    return above * float(np.exp(-gap_m / 0.02))


def _world_rotation(normal_cam: Float, gravity: Gravity, R_world_cam: Float | None, up_cam: Float | None) -> Float:
    if gravity == "world" and R_world_cam is not None:
        return np.asarray(R_world_cam, dtype=np.float64)
    z = normal_cam if up_cam is None else up_cam
    # The camera's right is the world's x, made horizontal; a camera on its side uses its up direction instead.
    right = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.9 else np.array([0.0, -1.0, 0.0])
    x = right - (right @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])
