"""The rigid motion that lays four points on four others with the least sum of squared distances, in closed form.

Thousands of fits a base: an iteration on the largest root of the characteristic polynomial is an order of magnitude
faster than a singular value decomposition, and tells the residual before a rotation is made. Source: Theobald, Acta
Cryst. A61 (2005) 478, on Horn's quaternion matrix.
"""

from __future__ import annotations

import numpy as np
from numba import njit

NEWTON_STEPS = 50
"""Most steps towards the largest root; it converges in about five."""


@njit(cache=True)
def fit_rms(a: np.ndarray, b: np.ndarray, N: np.ndarray) -> tuple[float, float]:
    """Root mean square distance left between ``a`` (n, 3) and the best rigid motion of ``b`` (n, 3), and a root.

    Fills ``N`` (4, 4) with Horn's matrix; :func:`rotation_of` makes the rotation of N and the root.
    """
    n = len(a)
    am, bm = np.zeros(3), np.zeros(3)
    for i in range(n):
        for k in range(3):
            am[k] += a[i, k] / n
            bm[k] += b[i, k] / n
    S = np.zeros((3, 3))
    energy = 0.0
    for i in range(n):
        for k in range(3):
            p = b[i, k] - bm[k]
            energy += p * p + (a[i, k] - am[k]) ** 2
            for m in range(3):
                S[k, m] += p * (a[i, m] - am[m])
    xx, xy, xz = S[0, 0], S[0, 1], S[0, 2]
    yx, yy, yz = S[1, 0], S[1, 1], S[1, 2]
    zx, zy, zz = S[2, 0], S[2, 1], S[2, 2]
    N[0, 0], N[1, 1], N[2, 2], N[3, 3] = xx + yy + zz, xx - yy - zz, -xx + yy - zz, -xx - yy + zz
    N[0, 1], N[0, 2], N[0, 3] = yz - zy, zx - xz, xy - yx
    N[1, 2], N[1, 3], N[2, 3] = xy + yx, zx + xz, yz + zy
    N[1, 0], N[2, 0], N[3, 0], N[2, 1], N[3, 1], N[3, 2] = N[0, 1], N[0, 2], N[0, 3], N[1, 2], N[1, 3], N[2, 3]
    squares = 0.0
    for k in range(3):
        for m in range(3):
            squares += S[k, m] * S[k, m]
    c2 = -2.0 * squares
    c1 = -8.0 * (xx * (yy * zz - yz * zy) - xy * (yx * zz - yz * zx) + xz * (yx * zy - yy * zx))
    c0 = _det4(N)
    root = 0.5 * energy  # never below the largest root, from where Newton's steps descend to it
    for _ in range(NEWTON_STEPS):
        slope = (4.0 * root * root + 2.0 * c2) * root + c1
        if slope == 0.0:
            break
        step = ((root * root + c2) * root * root + c1 * root + c0) / slope
        root -= step
        if abs(step) <= 1e-14 * root:
            break
    return np.sqrt(max(0.0, (energy - 2.0 * root) / n)), root


@njit(cache=True)
def rotation_of(N: np.ndarray, root: float, R: np.ndarray) -> bool:
    """Fills ``R`` with the rotation of N's largest root; False if there is not one, but many (points in a line).

    The quaternion is any column of the adjugate of N - root·1; the longest is the one that rounding hurts least.
    """
    M = N.copy()
    for k in range(4):
        M[k, k] -= root
    best = np.zeros(4)
    longest = 0.0
    q = np.empty(4)
    for row in range(4):
        for column in range(4):
            q[column] = _cofactor(M, row, column)
        length = q @ q
        if length > longest:
            longest = length
            best[:] = q
    scale = max(abs(root), 1e-300)
    if longest <= (1e-10 * scale * scale * scale) ** 2:
        return False
    w, x, y, z = best / np.sqrt(longest)
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    return True


@njit(cache=True)
def _cofactor(M: np.ndarray, row: int, column: int) -> float:
    r0, r1, r2 = (row + 1) % 4, (row + 2) % 4, (row + 3) % 4
    c0, c1, c2 = (column + 1) % 4, (column + 2) % 4, (column + 3) % 4
    minor = (
        M[r0, c0] * (M[r1, c1] * M[r2, c2] - M[r1, c2] * M[r2, c1])
        - M[r0, c1] * (M[r1, c0] * M[r2, c2] - M[r1, c2] * M[r2, c0])
        + M[r0, c2] * (M[r1, c0] * M[r2, c1] - M[r1, c1] * M[r2, c0])
    )
    # The three rows that are left come in a circle, which is an even permutation of their order; the columns likewise.
    return minor if (row + column) % 2 == 0 else -minor


@njit(cache=True)
def _det4(M: np.ndarray) -> float:
    total = 0.0
    for column in range(4):
        total += M[0, column] * _cofactor(M, 0, column)
    return total
