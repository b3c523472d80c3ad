"""The pinhole camera: OpenCV axes (+x right, +y down, +z forward), depth is z, pixel centres at integers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verefine_viz.core.arrays import Float, finite
from verefine_viz.core.errors import ShapeError

FOCAL_PX = (1.0, 1e6)
"""Least and largest focal length [px]: beyond lie mistakes, and pixels that no integer can number."""
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
        check_intrinsics(K)
        if self.width <= 0 or self.height <= 0:
            raise ShapeError(f"the image is {self.width}×{self.height}, expected positive sizes")
        object.__setattr__(self, "K", K)

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
        v, u = np.mgrid[0 : depth_m.shape[0], 0 : depth_m.shape[1]]
        z = depth_m.astype(np.float64)
        return np.stack([(u - self.cx) / self.fx * z, (v - self.cy) / self.fy * z, z], axis=-1)

    def project(self, points_cam: Float) -> Float:
        """Pixel coordinates (…, 2) = (u, v) of points (…, 3) [m] in front of the camera."""
        z = points_cam[..., 2]
        return np.stack(
            [points_cam[..., 0] / z * self.fx + self.cx, points_cam[..., 1] / z * self.fy + self.cy], axis=-1
        )


def check_intrinsics(K: Float) -> None:
    """Raises ShapeError where a focal length, the principal point or the skew of a matrix (3, 3) [px] is impossible."""
    low, high = FOCAL_PX
    if not (low <= K[0, 0] <= high and low <= K[1, 1] <= high):
        raise ShapeError(
            f"cam_K has focal lengths {K[0, 0]:g}, {K[1, 1]:g}; expected positive pixels, {low:g} to {high:g}"
        )
    if not np.abs(K[:2, 2]).max() <= FARTHEST_PX:
        raise ShapeError(
            f"cam_K has the principal point {K[0, 2]:g}, {K[1, 2]:g}; expected pixels within ±{FARTHEST_PX:g}"
        )
    if not max(abs(K[0, 1]), abs(K[1, 0])) <= FARTHEST_PX:
        raise ShapeError(f"cam_K has a skew of {K[0, 1]:g}, {K[1, 0]:g}; expected pixels within ±{FARTHEST_PX:g}")
