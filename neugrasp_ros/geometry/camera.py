# SPDX-License-Identifier: Apache-2.0
"""Pinhole cameras: intrinsics and the way from depth to points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, ShapeError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """Pinhole intrinsics without distortion.

    Pixel (column u, row v) looks along ``((u - cx) / fx, (v - cy) / fy, 1)`` in the
    camera frame: pixel centres have integer coordinates.

    Attributes:
        width: Columns in [pixel].
        height: Rows in [pixel].
        fx: Focal length along the columns in [pixel].
        fy: Focal length along the rows in [pixel].
        cx: Column of the principal point in [pixel].
        cy: Row of the principal point in [pixel].
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        """Reject a camera that cannot be.

        Raises:
            ConfigError: If a size or focal length is not positive.
        """
        if self.width < 1 or self.height < 1:
            raise ConfigError(f"image size {self.width}x{self.height} is empty")
        if not (self.fx > 0 and self.fy > 0):
            raise ConfigError(
                f"focal lengths must be positive, got fx={self.fx}, fy={self.fy}"
            )

    @classmethod
    def from_hfov(cls, width: int, height: int, hfov: float) -> "Intrinsics":
        """Return square pixels with a horizontal field of view ``hfov`` in [rad]."""
        focal = width / 2 / np.tan(hfov / 2)
        return cls(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0)

    def scaled(self, factor: float) -> "Intrinsics":
        """Return the intrinsics of the image resized by ``factor``."""
        return Intrinsics(
            round(self.width * factor),
            round(self.height * factor),
            self.fx * factor,
            self.fy * factor,
            (self.cx + 0.5) * factor - 0.5,
            (self.cy + 0.5) * factor - 0.5,
        )

    def ray_directions(self) -> FloatArray:
        """Return the camera-frame rays with z = 1 of all pixels, shape (H, W, 3)."""
        u = (np.arange(self.width) - self.cx) / self.fx
        v = (np.arange(self.height) - self.cy) / self.fy
        rays = np.ones((self.height, self.width, 3))
        rays[..., 0] = u[None, :]
        rays[..., 1] = v[:, None]
        return rays


BENCHMARK_INTRINSICS = Intrinsics(640, 480, 540.0, 540.0, 320.0, 240.0)
"""The clutter-removal benchmark's camera (method sheet, a9)."""


def deproject(depth: NDArray[np.float32], intrinsics: Intrinsics) -> FloatArray:
    """Lift a depth image to points.

    Args:
        depth: Distance along the optical axis in [m], shape (H, W); not finite or
            not positive means not measured.
        intrinsics: The camera.

    Returns:
        Points in the camera frame in [m], shape (H, W, 3), NaN where not measured.

    Raises:
        ShapeError: If the image does not have the size of the intrinsics.
    """
    if depth.shape != (intrinsics.height, intrinsics.width):
        raise ShapeError(
            "depth", f"({intrinsics.height}, {intrinsics.width})", depth.shape
        )
    valid = np.isfinite(depth) & (depth > 0)
    z = np.where(valid, depth, np.nan).astype(np.float64)
    return intrinsics.ray_directions() * z[..., None]
