"""The pinhole camera: OpenCV axes (+x right, +y down, +z forward), depth is z, pixel centres at integers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, finite, set_fields
from verefine_viz.core.errors import ShapeError

LAST_ROW = (0.0, 0.0, 1.0)
FOCAL_PX = (1.0, 1e6)
"""Least and largest focal length [px]; others are mistakes, or give pixel numbers beyond any integer."""
LEAST_FOCAL = 0.05
"""Least focal length as a share of the image's width: that of a lens of 168°."""
NORMALISED = 10.0
"""Focal length below which a matrix is in units of the image width, not in pixels."""
FARTHEST_PX = 1e6
"""Largest distance of the principal point from the image's corner, along each axis, and largest skew [px]."""


@dataclass(frozen=True, eq=False)
class Camera:
    """Intrinsics of one image.

    Pixel (row v, column u) looks along ``((u - cx)/fx, (v - cy)/fy, 1)``: the depth sensor's convention.
    """

    K: Float
    """(3, 3) [px]; skew is not supported."""
    width: int
    height: int

    def __post_init__(self) -> None:
        K = finite(self.K, "cam_K", (3, 3))
        check_intrinsics(K, self.width)
        if self.width <= 0 or self.height <= 0:
            raise ShapeError(f"the image is {self.width}×{self.height}, expected positive sizes")
        set_fields(self, K=K)

    @property
    def fx(self) -> float:
        return float(self.K[0, 0])

    @property
    def fy(self) -> float:
        return float(self.K[1, 1])

    @property
    def cx(self) -> float:
        return float(self.K[0, 2])

    @property
    def cy(self) -> float:
        return float(self.K[1, 2])

    @property
    def shape(self) -> tuple[int, int]:
        """(height, width), the shape of its images."""
        return self.height, self.width

    def back_project(self, depth_m: NDArray[np.floating]) -> Float:
        """Points (H, W, 3) [m] in the camera frame of a depth image (H, W) [m]; (0, 0, 0) where depth is 0."""
        h, w = depth_m.shape
        points = np.empty((h, w, 3))
        points[..., 2] = depth_m
        z = points[..., 2]
        np.multiply((np.arange(w) - self.cx) / self.fx, z, out=points[..., 0])
        np.multiply(((np.arange(h) - self.cy) / self.fy)[:, None], z, out=points[..., 1])
        return points

    def project(self, points_cam: Float) -> Float:
        """Pixel coordinates (…, 2) = (u, v) of points (…, 3) [m] in front of the camera."""
        z = points_cam[..., 2]
        return np.stack(
            [points_cam[..., 0] / z * self.fx + self.cx, points_cam[..., 1] / z * self.fy + self.cy], axis=-1
        )


def check_intrinsics(K: Float, width: int = 0) -> None:
    """Raise ShapeError where a matrix (3, 3) [px] cannot be that of a camera with images of this width."""
    if not np.allclose(K[2], LAST_ROW, rtol=0, atol=1e-6):
        is_turned = np.allclose(K[:, 2], LAST_ROW, rtol=0, atol=1e-6)
        how = "; it looks written column by column: write it row by row, fx 0 cx 0 fy cy 0 0 1" * is_turned
        raise ShapeError(f"the last row of 'cam_K' is {' '.join(f'{x:g}' for x in K[2])}, expected 0 0 1{how}")
    low, high = FOCAL_PX
    if not (low <= K[0, 0] <= high and low <= K[1, 1] <= high) or min(K[0, 0], K[1, 1]) < LEAST_FOCAL * width:
        is_normalised = bool(min(K[0, 0], K[1, 1]) > 0 and np.abs(K).max() < NORMALISED)
        how = f", not less than {LEAST_FOCAL:.0%} of the image's width" if width else ""
        how += "; it looks normalised: multiply it by the image's width and height" * is_normalised
        raise ShapeError(
            f"cam_K has focal lengths {K[0, 0]:g}, {K[1, 1]:g}; expected positive pixels, {low:g} to {high:g}{how}"
        )
    if not np.abs(K[:2, 2]).max() <= FARTHEST_PX:
        raise ShapeError(
            f"cam_K has the principal point {K[0, 2]:g}, {K[1, 2]:g}; expected pixels within ±{FARTHEST_PX:g}"
        )
    if not max(abs(K[0, 1]), abs(K[1, 0])) <= FARTHEST_PX:
        raise ShapeError(f"cam_K has a skew of {K[0, 1]:g}, {K[1, 0]:g}; expected pixels within ±{FARTHEST_PX:g}")
