"""The loop of ICP (docs/methods.md 4.1) as one compiled call: match, fit, move, stop. Single-threaded, same bits."""

from __future__ import annotations

import numpy as np

from verefine_viz.core.kernels import kernel
from verefine_viz.refiners.nearest import NearestIndex, nearest_of_all

ALL_ITERATIONS, TOLERANCE, PUBLISHED = 0, 1, 2
"""Stop rules, as the kernel takes them."""
STEP_TOLERANCE = 1e-6
"""A step is small if 1 − cos(angle) and the squared shift [m²] are both below this (PCL's transformation epsilon)."""
ERROR_TOLERANCE_M2 = 1e-12
"""A change of the mean squared distance below this ends the loop [m²] (PCL's absolute epsilon)."""
RELATIVE_TOLERANCE = 1.0
"""The published relative epsilon: met as soon as there is a previous error, unless the error doubles, so it means 2
steps."""
MAX_ROUNDS, SETTLED = 20, 1e-14
"""Most rounds of the polar decomposition, and the change of an entry below which it ends."""
FLAT = 1e-6
"""A matrix whose determinant is below this share of its cubed norm is left to LAPACK."""
DAMPING = 1e-3
"""Point-to-plane: share of the mean curvature added to every direction, so that a motion that flat faces leave free
(sliding along them) does not occur."""


@kernel()
def icp_loop(
    source: np.ndarray,
    source_normals: np.ndarray,
    index: NearestIndex,
    normals: np.ndarray,
    gates_m: np.ndarray,
    n_shrinking: int,
    stop: int,
    plane: bool,
    pivot: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, int, int, float]:
    """Moves ``source`` onto the indexed cloud; returns R (3, 3), t (3,), iterations, last matches and their mse [m²].

    Args:
        source: (N, 3) cloud that moves.
        source_normals: (N, 3) its normals, zero where unknown; (0, 3) takes every match.
        index: of the cloud (M, 3) that stays.
        normals: (M, 3) of that cloud; (0, 3) if neither normals nor planes are used.
        gates_m: (K,) largest distance of a match in each iteration; K is the most iterations.
        n_shrinking: iterations during which the gate still changes, and a small step does not end the loop.
        stop: ``ALL_ITERATIONS``, ``TOLERANCE`` or ``PUBLISHED``.
        plane: minimise distances to tangent planes instead of points.
        pivot: (3,) whose displacement is the "shift" of a step: the origin of the frame that PCL would work in.
    """
    n = len(source)
    check_sides = len(source_normals) > 0
    R, t = np.eye(3), np.zeros(3)
    moved = np.empty((n, 3))
    match = np.zeros(n, dtype=np.int64)
    squared = np.empty(n)
    used = np.empty(n, dtype=np.bool_)
    points = index.points
    n_matches, mse, previous_mse = 0, 0.0, np.inf
    for iteration in range(len(gates_m)):
        gate_squared = gates_m[iteration] * gates_m[iteration]
        n_matches, total = 0, 0.0
        for i in range(n):
            moved[i, 0], moved[i, 1], moved[i, 2] = apply(R, t, source[i])
        nearest_of_all(moved, gate_squared, index, match, squared)
        for i in range(n):
            used[i] = squared[i] <= gate_squared
            if used[i] and check_sides:
                used[i] = _turned_dot(R, source_normals[i], normals[match[i]]) >= 0.0
            if used[i]:
                n_matches += 1
                total += squared[i]
        if n_matches < 3:
            return R, t, iteration, n_matches, 0.0
        mse = total / n_matches
        step_R, step_t = (
            _plane_step(moved, points, normals, match, used) if plane else point_step(moved, points, match, used)
        )
        R = step_R @ R
        t = step_R @ t + step_t
        if stop != ALL_ITERATIONS and iteration >= n_shrinking:
            shift = step_R @ pivot + step_t - pivot
            cosine = 0.5 * (step_R[0, 0] + step_R[1, 1] + step_R[2, 2] - 1.0)
            if cosine >= 1.0 - STEP_TOLERANCE and shift @ shift <= STEP_TOLERANCE:
                return R, t, iteration + 1, n_matches, mse
            change = abs(mse - previous_mse)
            if change < ERROR_TOLERANCE_M2:
                return R, t, iteration + 1, n_matches, mse
            if stop == PUBLISHED and change < RELATIVE_TOLERANCE * previous_mse and previous_mse < np.inf:
                return R, t, iteration + 1, n_matches, mse
        previous_mse = mse
    return R, t, len(gates_m), n_matches, mse


@kernel(nogil=True)
def refined_pose(
    R: np.ndarray,
    t: np.ndarray,
    points_cam: np.ndarray,
    normals_cam: np.ndarray,
    index: NearestIndex,
    normals: np.ndarray,
    gates_m: np.ndarray,
    n_shrinking: int,
    stop: int,
    plane: bool,
) -> tuple[np.ndarray, np.ndarray, int]:
    """:func:`icp_loop` from a pose (R, t) of the model in the camera frame: the refined pose and the iterations.

    Args:
        R: (3, 3) of T_cam_obj.
        t: (3,).
        points_cam: (N, 3) the observed cloud.
        normals_cam: (N, 3) its normals, or (0, 3); both are moved into the model's frame.
        index: of the model's cloud.
        normals: as in :func:`icp_loop`.
        gates_m: as there.
        n_shrinking: as there.
        stop: as there.
        plane: as there.
    """
    # The published gate and tolerance hold in the camera's frame, whose origin is the pivot.
    pivot = -(R.T @ t)
    source, source_normals = np.empty_like(points_cam), np.empty_like(normals_cam)
    _turn_back(R, t, points_cam, source)
    _turn_back(R, np.zeros(3), normals_cam, source_normals)
    step_R, step_t, n_iterations, _, _ = icp_loop(
        source, source_normals, index, normals, gates_m, n_shrinking, stop, plane, pivot
    )
    # The observed points moved by Y in the model's frame, so the model moves by its inverse: T · Y⁻¹.
    R_new = R @ step_R.T
    return R_new, t - R_new @ step_t, n_iterations


@kernel()
def _turn_back(R: np.ndarray, t: np.ndarray, points: np.ndarray, out: np.ndarray) -> None:
    """``out`` = Rᵀ (p − t) for each of ``points`` (N, 3)."""
    for i in range(len(points)):
        x, y, z = points[i, 0] - t[0], points[i, 1] - t[1], points[i, 2] - t[2]
        for k in range(3):
            out[i, k] = R[0, k] * x + R[1, k] * y + R[2, k] * z


@kernel()
def apply(R: np.ndarray, t: np.ndarray, p: np.ndarray) -> tuple[float, float, float]:
    """``R p + t``."""
    return (
        R[0, 0] * p[0] + R[0, 1] * p[1] + R[0, 2] * p[2] + t[0],
        R[1, 0] * p[0] + R[1, 1] * p[1] + R[1, 2] * p[2] + t[1],
        R[2, 0] * p[0] + R[2, 1] * p[1] + R[2, 2] * p[2] + t[2],
    )


@kernel()
def _turned_dot(R: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """``(R a) · b``."""
    return (
        (R[0, 0] * a[0] + R[0, 1] * a[1] + R[0, 2] * a[2]) * b[0]
        + (R[1, 0] * a[0] + R[1, 1] * a[1] + R[1, 2] * a[2]) * b[1]
        + (R[2, 0] * a[0] + R[2, 1] * a[1] + R[2, 2] * a[2]) * b[2]
    )


@kernel()
def point_step(
    moved: np.ndarray, points: np.ndarray, match: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The rigid step with the least sum of squared distances (Umeyama without scale)."""
    # One pass, about a point near both clouds: the mean subtracted at the end is then no larger than the result.
    ox, oy, oz = points[match[0], 0], points[match[0], 1], points[match[0], 2]
    ax, ay, az, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    n_matches = 0  # As an argument, it would make numba compile this twice: for a float, and for the initial 0.
    for i in range(len(moved)):
        if used[i]:
            n_matches += 1
            j = match[i]
            px, py, pz = moved[i, 0] - ox, moved[i, 1] - oy, moved[i, 2] - oz
            qx, qy, qz = points[j, 0] - ox, points[j, 1] - oy, points[j, 2] - oz
            ax, ay, az = ax + px, ay + py, az + pz
            bx, by, bz = bx + qx, by + qy, bz + qz
            xx, xy, xz = xx + qx * px, xy + qx * py, xz + qx * pz
            yx, yy, yz = yx + qy * px, yy + qy * py, yz + qy * pz
            zx, zy, zz = zx + qz * px, zy + qz * py, zz + qz * pz
    ax, ay, az = ax / n_matches, ay / n_matches, az / n_matches
    bx, by, bz = bx / n_matches, by / n_matches, bz / n_matches
    nx, ny, nz = n_matches * bx, n_matches * by, n_matches * bz
    H = np.array(
        [
            [xx - nx * ax, xy - nx * ay, xz - nx * az],
            [yx - ny * ax, yy - ny * ay, yz - ny * az],
            [zx - nz * ax, zy - nz * ay, zz - nz * az],
        ]
    )
    a, b = np.array([ax + ox, ay + oy, az + oz]), np.array([bx + ox, by + oy, bz + oz])
    R = nearest_rotation(H)
    return R, b - R @ a


@kernel()
def nearest_rotation(H: np.ndarray) -> np.ndarray:
    """The rotation R (3, 3) that maximises trace(Rᵀ H): ``core.geometry.nearest_rotation`` for compiled loops.

    Where H keeps orientation it is the orthogonal factor of H's polar decomposition. Newton's iteration for it
    (Higham 1986), scaled by Frobenius norms, needs about six rounds of a few dozen operations; LAPACK's singular values
    take ten times as long, and are used only for flat or mirrored matrices.
    """
    X = H.copy()
    for _ in range(MAX_ROUNDS):
        a, b, c = X[0, 0], X[0, 1], X[0, 2]
        d, e, f = X[1, 0], X[1, 1], X[1, 2]
        g, h, i = X[2, 0], X[2, 1], X[2, 2]
        # The cofactors C: X⁻ᵀ = C / det X.
        A, B, C = e * i - f * h, f * g - d * i, d * h - e * g
        D, E, F = c * h - b * i, a * i - c * g, b * g - a * h
        G, J, K = b * f - c * e, c * d - a * f, a * e - b * d
        det = a * A + b * B + c * C
        size = a * a + b * b + c * c + d * d + e * e + f * f + g * g + h * h + i * i
        if not det > FLAT * size**1.5:
            break
        inverse_size = (A * A + B * B + C * C + D * D + E * E + F * F + G * G + J * J + K * K) / (det * det)
        scale = (inverse_size / size) ** 0.25
        p, q = 0.5 * scale, 0.5 / (scale * det)
        X[0, 0], X[0, 1], X[0, 2] = p * a + q * A, p * b + q * B, p * c + q * C
        X[1, 0], X[1, 1], X[1, 2] = p * d + q * D, p * e + q * E, p * f + q * F
        X[2, 0], X[2, 1], X[2, 2] = p * g + q * G, p * h + q * J, p * i + q * K
        change = max(abs(X[0, 0] - a), abs(X[0, 1] - b), abs(X[0, 2] - c))
        change = max(change, abs(X[1, 0] - d), abs(X[1, 1] - e), abs(X[1, 2] - f))
        change = max(change, abs(X[2, 0] - g), abs(X[2, 1] - h), abs(X[2, 2] - i))
        if change < SETTLED:
            return X
    U, _, Vt = np.linalg.svd(H)
    if _determinant(U) * _determinant(Vt) < 0.0:
        for row in range(3):
            U[row, 2] *= -1.0
    return U @ Vt


@kernel()
def _determinant(M: np.ndarray) -> float:
    """The determinant of M (3, 3) by cofactors, which compile in a tenth of the time that LAPACK's takes."""
    return (
        M[0, 0] * (M[1, 1] * M[2, 2] - M[1, 2] * M[2, 1])
        + M[0, 1] * (M[1, 2] * M[2, 0] - M[1, 0] * M[2, 2])
        + M[0, 2] * (M[1, 0] * M[2, 1] - M[1, 1] * M[2, 0])
    )


@kernel()
def _plane_step(
    moved: np.ndarray, points: np.ndarray, normals: np.ndarray, match: np.ndarray, used: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The rigid step that brings the points nearest to the tangent planes of their matches (small-angle fit)."""
    centre = np.zeros(3)
    n = 0
    for i in range(len(moved)):
        if used[i]:
            n += 1
            for k in range(3):
                centre[k] += moved[i, k]
    for k in range(3):
        centre[k] /= n
    A = np.zeros((6, 6))
    rhs = np.zeros(6)
    row = np.empty(6)
    for i in range(len(moved)):
        if used[i]:
            j = match[i]
            x, y, z = moved[i, 0] - centre[0], moved[i, 1] - centre[1], moved[i, 2] - centre[2]
            nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
            row[0], row[1], row[2] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
            row[3], row[4], row[5] = nx, ny, nz
            gap = (
                (points[j, 0] - moved[i, 0]) * nx
                + (points[j, 1] - moved[i, 1]) * ny
                + (points[j, 2] - moved[i, 2]) * nz
            )
            for r in range(6):
                rhs[r] += row[r] * gap
                for c in range(6):
                    A[r, c] += row[r] * row[c]
    # Turns and shifts have different units: each block is damped by its own scale.
    turns = A[0, 0] + A[1, 1] + A[2, 2]
    shifts = A[3, 3] + A[4, 4] + A[5, 5]
    for k in range(3):
        A[k, k] += DAMPING * turns + 1e-15
        A[k + 3, k + 3] += DAMPING * shifts + 1e-15
    step = np.linalg.solve(A, rhs)
    R = _rotation(step[:3])
    return R, centre + step[3:] - R @ centre


@kernel()
def _rotation(vector: np.ndarray) -> np.ndarray:
    """The rotation of a rotation vector (Rodrigues)."""
    angle = np.sqrt(vector @ vector)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector[0] / angle, vector[1] / angle, vector[2] / angle
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)
