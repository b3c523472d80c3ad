"""Estimates the camera's motion between two frames of a scene that stands still: docs/methods.md 9.3.

Where the data set states camera poses, they give the motion, and the images check it. Elsewhere both depth images are
registered: point to plane, with the pixel that a point falls on as its match (projective association), and the change
of grey values beside it, as flat scenes slide along themselves (the joint cost of Park et al., "Colored Point Cloud
Registration Revisited", ICCV 2017). Labelled objects have as much weight as everything else, so that a
bare table does not dominate. In directions that nothing determines the start is kept, and the motion is then unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from verefine_viz.core.arrays import Float, Mask
from verefine_viz.core.geometry import angle_between, apply, as_rigid, axis_angle, inverse, transform
from verefine_viz.core.observation import Observation
from verefine_viz.core.problem import Placed
from verefine_viz.scenes.own_pixels import fit_reach_m, own_pixels

MOST_POINTS = 5000
"""Most points of the labelled objects together, and of the rest."""
LEVELS = ((0.06, 6.0), (0.03, 3.0), (0.012, 1.5))
"""Largest distance of a match along its ray [m], and blur of the grey values [px]: from coarse to fine."""
MOST_STEPS, REST_M = 15, 2e-5
"""Most steps at each level, and the step below which it ends [m]; turns count by the motion of the points."""
DEPTH_SIGMA_M, GREY_SIGMA = 0.003, 8.0
"""Expected differences of depth [m] and grey values (of 255) for the right motion."""
HELD = 0.004
"""Least curvature along a determined direction, as a share of the largest: slides of a bare plane have up to 0.001."""
ALIKE = 0.5
"""Least cosine between the normals of a match."""
EXPLAINED_SHARE, EXPLAINED_M = 0.01, 0.005
"""Difference up to which depth is explained, as a share of it, and at least [m]."""
FEWEST_POINTS, LEAST_SHOWN = 300, 0.3
"""Least number of measured points of the last frame, and least share of them that the next one shows."""
LEAST_EXPLAINED = 0.6
"""Least explained share of what both frames see for a motion to be accepted."""
POSES_AGREE_M = 0.015
"""Distance that points may lie from where camera poses put them; calibrations and trackers are off by millimetres."""

Indices = NDArray[np.int64]
Source = Literal["camera poses", "registered"]


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Motion of the camera from one frame to the next."""

    T_next_last: Float
    """(4, 4) points in the last camera's frame to the next one's [m]."""
    source: Source
    explained: float
    """Share, in [0, 1], of what both frames see that has the expected depth; labelled objects make up half of it."""
    words: str
    """Description for the user."""


@dataclass(frozen=True)
class UnknownMotion:
    """Why no motion of the camera is known."""

    words: str


def camera_motion(
    last: Observation, following: Observation, labelled: Sequence[Placed], before: Float | None = None
) -> CameraMotion | UnknownMotion:
    """The camera's motion between two frames.

    Args:
        last: the frame with labels.
        following: the next frame.
        labelled: the objects of the last frame at their poses.
        before: (4, 4) the motion before this one, as a start [m].
    """
    seen = _seen_in(last, labelled)
    if len(seen.points) < FEWEST_POINTS:
        return UnknownMotion(f"Only {len(seen.points)} points of the last frame have depth and a normal.")
    pictures = [_Picture.of(following, last, blur_px) for _, blur_px in LEVELS]
    stated = _stated(last, following)
    if stated is None:
        best = _best(seen, following, pictures, [np.eye(4), before], _known_turn(last, following))
        if best.fault:
            return UnknownMotion(best.fault)
        return CameraMotion(best.T, "registered", best.explained, f"{best.explained:.0%} of the scene registered")
    return _checked(seen, following, pictures, stated, before)


def _checked(
    seen: _Seen, following: Observation, pictures: Sequence[_Picture | None], stated: Float, before: Float | None
) -> CameraMotion | UnknownMotion:
    """The motion (4, 4) that camera poses state, unless the images show another one."""
    at_stated = _fit(seen, following, pictures[-1], stated, True)
    agreed = CameraMotion(stated, "camera poses", at_stated.explained, f"{at_stated.explained:.0%} as camera poses say")
    if not at_stated.fault:
        from_stated = _registered(seen, following, pictures, stated, None)
        if from_stated.is_held and _apart_m(seen, stated, from_stated.T) <= POSES_AGREE_M:
            return agreed
    best = _best(seen, following, pictures, [np.eye(4), before, stated], None)
    if best.fault or best.agreement <= at_stated.agreement:
        return UnknownMotion(at_stated.fault) if at_stated.fault else agreed
    off_mm, off_deg = 1e3 * _apart_m(seen, stated, best.T), np.degrees(angle_between(stated[:3, :3], best.T[:3, :3]))
    words = f"{best.explained:.0%} of the scene registered; camera poses are {off_mm:.0f} mm, {off_deg:.1f}° off"
    return CameraMotion(best.T, "registered", best.explained, words)


def _best(
    seen: _Seen,
    following: Observation,
    pictures: Sequence[_Picture | None],
    starts: Sequence[Float | None],
    R_next_last: Float | None,
) -> _Fit:
    """The best of the registrations from all starts; a known rotation (3, 3) that does not fit is ignored."""
    fits = [_registered(seen, following, pictures, start, R_next_last) for start in starts if start is not None]
    best = max(fits, key=lambda fit: fit.agreement)
    if R_next_last is None or not best.fault:
        return best
    return _best(seen, following, pictures, starts, None)


def _stated(last: Observation, following: Observation) -> Float | None:
    """The motion that camera poses give; None where either has none."""
    if last.T_map_cam is None or following.T_map_cam is None:
        return None
    return as_rigid(inverse(following.T_map_cam) @ last.T_map_cam, "camera motion")


def _known_turn(last: Observation, following: Observation) -> Float | None:
    """The rotation (3, 3) where the data set states the orientation of both cameras, and gravity comes from it."""
    supports = last.support, following.support
    if any(support is None or support.gravity_source != "world" for support in supports):
        return None
    R_world_last, R_world_next = (support.T_world_cam[:3, :3] for support in supports if support is not None)
    return R_world_next.T @ R_world_last


@dataclass(frozen=True, eq=False)
class _Seen:
    """Points of the last frame, with their normals and weights."""

    points: Float
    """(N, 3) [m]."""
    normals: Float
    """(N, 3)."""
    weights: Float
    """(N,) that sum to 1."""
    v: Indices
    """(N,) rows of their pixels."""
    u: Indices


def _seen_in(last: Observation, labelled: Sequence[Placed]) -> _Seen:
    """Points of the labelled objects and of the rest, each half of the weight."""
    measured = (last.depth_m > 0) & last.normals_cam.any(axis=-1)
    is_labelled = np.zeros(last.camera.shape, np.bool_)
    for one in labelled:
        others = [other for other in labelled if other is not one]
        is_labelled |= own_pixels(last, one.model, one.T_cam_obj, others, fit_reach_m(one.model))
    parts = [_some(measured & is_labelled), _some(measured & ~is_labelled)]
    parts = [part for part in parts if len(part)]
    chosen = np.concatenate(parts) if parts else np.zeros(0, np.int64)
    weights = np.concatenate([np.full(len(part), 1 / len(part)) for part in parts] or [np.zeros(0)])
    v, u = np.unravel_index(chosen, last.camera.shape)
    camera, z = last.camera, last.depth_m[v, u].astype(np.float64)
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], axis=-1)
    return _Seen(points, last.normals_cam[v, u].astype(np.float64), weights / max(len(parts), 1), v, u)


def _some(mask: Mask) -> Indices:
    """Flat indices (N,) of at most ``MOST_POINTS`` of its pixels."""
    pixels = np.flatnonzero(mask)
    return pixels if len(pixels) <= MOST_POINTS else np.random.default_rng(0).choice(pixels, MOST_POINTS, replace=False)


@dataclass(frozen=True, eq=False)
class _Picture:
    """Grey values of both frames, blurred alike."""

    last: Float
    """(H, W)."""
    following: Float
    """(H, W, 3) grey value, its slope along u and along v [1/px]."""

    @staticmethod
    def of(following: Observation, last: Observation, blur_px: float) -> _Picture | None:
        if following.rgb is None or last.rgb is None:
            return None
        grey = [gaussian_filter(one.mean(axis=-1, dtype=np.float32), blur_px) for one in (last.rgb, following.rgb)]
        along_v, along_u = np.gradient(grey[1])
        return _Picture(grey[0], np.stack([grey[1], along_u, along_v], axis=-1))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Quality of a motion; shares are by weight."""

    T: Float
    shown: float
    """Share of the points that the next frame shows."""
    explained: float
    """Share of these whose depth agrees with the measured one."""
    agreement: float
    """Agreement of depth and grey values over all points, in [0, 1], by which motions are compared."""
    is_held: bool
    """Whether the images determine it in all directions."""

    @property
    def fault(self) -> str:
        """Why the motion is not accepted; empty where it is."""
        if self.shown < LEAST_SHOWN:
            return f"The frames share {self.shown:.0%} of what is seen."
        if self.explained < LEAST_EXPLAINED:
            return f"Registration explains {self.explained:.0%} of the depth, {LEAST_EXPLAINED:.0%} needed."
        return "" if self.is_held else "The scene looks the same when it slides or turns: no shape or colour holds it."


def _fit(seen: _Seen, following: Observation, picture: _Picture | None, T: Float, is_held: bool) -> _Fit:
    moved = apply(T, seen.points)
    index, v, u = _falls_on(following, moved)
    index, v, u = (x[following.depth_m[v, u] > 0] for x in (index, v, u))
    z, own = moved[index, 2], seen.weights[index]
    away_m, shown = following.depth_m[v, u] - z, float(own.sum())
    fits = np.abs(away_m) < np.maximum(EXPLAINED_M, EXPLAINED_SHARE * z)
    good = _trust(away_m, 2 * DEPTH_SIGMA_M)
    if picture is not None:
        good = good * _trust(picture.following[v, u, 0] - picture.last[seen.v[index], seen.u[index]], 2 * GREY_SIGMA)
    explained = float(own[fits].sum()) / max(shown, 1e-12)
    return _Fit(as_rigid(T, "camera motion"), shown, explained, float(own @ good), is_held)


def _registered(
    seen: _Seen, following: Observation, pictures: Sequence[_Picture | None], T: Float, R_next_last: Float | None
) -> _Fit:
    """The motion that registration reaches from a start; only shifts are fitted where the rotation is known."""
    middle = seen.points.mean(axis=0)
    reach_m = float(np.sqrt(((seen.points - middle) ** 2).sum(axis=1).mean()))
    if R_next_last is not None:
        T = transform(R_next_last, T[:3, 3])
    free = 6 if R_next_last is None else 3
    is_held = False
    for (gate_m, _), picture in zip(LEVELS, pictures, strict=True):
        for _ in range(MOST_STEPS):
            at = apply(T, middle[None])[0]
            before, after, rests = _equations(seen, following, picture, T, gate_m, at, reach_m)
            before, after = before[:, :free], after[:, :free]
            A = before.T @ after
            curvatures, directions = np.linalg.eigh((A + A.T) / 2)
            held = curvatures > HELD * max(float(curvatures[-1]), 1e-12)
            is_held = bool(held.all())
            V = directions[:, held]
            step = V @ np.linalg.solve(V.T @ A @ V, V.T @ (before.T @ rests))
            turn = np.zeros(3) if free == 3 else step[3:] / reach_m
            angle = float(np.linalg.norm(turn))
            R = axis_angle(turn, angle) if angle > 0 else np.eye(3)
            T = transform(R, at + step[:3] - R @ at) @ T
            if np.linalg.norm(step) < REST_M:
                break
    return _fit(seen, following, pictures[-1], T, is_held)


def _equations(
    seen: _Seen, following: Observation, picture: _Picture | None, T: Float, gate_m: float, at: Float, reach_m: float
) -> tuple[Float, Float, Float]:
    """Equations of a step (shifts, then turns about ``at`` times the reach): weighted rows (M, 6) from the last frame,
    rows (M, 6) from the next one, and residuals (M,).

    The noise of both is independent, so that their product has no curvature from noise alone.
    """
    moved = apply(T, seen.points)
    index, v, u = _falls_on(following, moved)
    moved = moved[index]
    away_m = following.depth_m[v, u] - moved[:, 2]
    normals = following.normals_cam[v, u].astype(np.float64)
    own_normals = seen.normals[index] @ T[:3, :3].T
    alike = (normals * own_normals).sum(axis=1) > ALIKE
    taken = (following.depth_m[v, u] > 0) & (np.abs(away_m) < gate_m) & alike
    index, v, u = index[taken], v[taken], u[taken]
    moved, away_m, normals, own_normals = moved[taken], away_m[taken], normals[taken], own_normals[taken]
    to_match = moved / moved[:, 2:] * away_m[:, None]
    gaps_m = (normals * to_match).sum(axis=1)
    own, arms = seen.weights[index], (moved - at) / reach_m
    weights = own / DEPTH_SIGMA_M**2 * _trust(gaps_m, gate_m / 3)
    before = [weights[:, None] * np.hstack([own_normals, np.cross(arms, own_normals)])]
    after, rests = [np.hstack([normals, np.cross(arms, normals)])], [gaps_m]
    if picture is not None and len(index):
        grey, along_u, along_v = picture.following[v, u].astype(np.float64).T
        x, y, z = moved.T
        camera = following.camera
        # Grey values are read at the pixel's middle and continued to the point along their slope.
        offset_u, offset_v = x / z * camera.fx + camera.cx - u, y / z * camera.fy + camera.cy - v
        greys = picture.last[seen.v[index], seen.u[index]] - (grey + along_u * offset_u + along_v * offset_v)
        slope_u, slope_v = along_u * camera.fx / z, along_v * camera.fy / z
        slopes = np.stack([slope_u, slope_v, -(slope_u * x + slope_v * y) / z], axis=-1)
        after.append(np.hstack([slopes, np.cross(arms, slopes)]))
        weights = own / GREY_SIGMA**2 * _trust(greys, 3 * GREY_SIGMA)
        before.append(weights[:, None] * after[-1])
        rests.append(greys)
    return np.concatenate(before), np.concatenate(after), np.concatenate(rests)


def _trust(rests: Float, scale: float) -> Float:
    """Weights (N,) of Geman and McClure: residuals far above the scale belong to something that moved."""
    return 1 / (1 + (rests / scale) ** 2) ** 2


def _falls_on(following: Observation, moved: Float) -> tuple[Indices, Indices, Indices]:
    """Indices (M,) of the points (N, 3) that fall into the next image, and their pixels' rows and columns."""
    height, width = following.camera.shape
    ahead = np.flatnonzero(moved[:, 2] > 1e-3)
    u, v = np.rint(following.camera.project(moved[ahead])).astype(np.int64).T
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    return ahead[inside], v[inside], u[inside]


def _apart_m(seen: _Seen, T_a: Float, T_b: Float) -> float:
    """Distance of the points under two motions, root mean square [m]."""
    return float(np.sqrt(((apply(T_a, seen.points) - apply(T_b, seen.points)) ** 2).sum(axis=1).mean()))
