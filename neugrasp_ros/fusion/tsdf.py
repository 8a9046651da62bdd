# SPDX-License-Identifier: Apache-2.0
"""Projective truncated signed distances of a cube from depth images.

In: depth images with their camera poses. Out: a dense ``TsdfVolume``.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, EmptySceneError, ShapeError
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.transform import invert

FloatArray = NDArray[np.float64]

TRUNCATION_VOXELS = 4.0  # [voxel], as the benchmark's volume (method sheet, a9)


@dataclass(frozen=True, eq=False, slots=True)
class TsdfVolume:
    """Truncated signed distances on a grid whose corner is the task frame's origin.

    Attributes:
        distances: Signed distance in units of ``truncation``, -1..1, positive in front
            of the surface; NaN = never observed. Shape (X, Y, Z), voxel (i, j, k) is
            centred at ``(i + 0.5, j + 0.5, k + 0.5) * voxel_size``.
        weights: Observations of each voxel, shape (X, Y, Z).
        voxel_size: Voxel edge in [m].
        truncation: Distance that a stored 1 stands for, in [m].
        view_count: Images integrated.
    """

    distances: NDArray[np.float32]
    weights: NDArray[np.uint8]
    voxel_size: float
    truncation: float
    view_count: int = 0

    def __post_init__(self) -> None:
        """Check that both grids have the same three-dimensional shape.

        Raises:
            ShapeError: If they do not.
        """
        if self.distances.ndim != 3:
            raise ShapeError("distances", "(X, Y, Z)", self.distances.shape)
        if self.weights.shape != self.distances.shape:
            raise ShapeError("weights", str(self.distances.shape), self.weights.shape)

    @property
    def size(self) -> FloatArray:
        """Edge lengths of the volume in [m], shape (3,)."""
        return np.array(self.distances.shape) * self.voxel_size

    @property
    def observed(self) -> NDArray[np.bool_]:
        """Which voxels a camera has seen into, shape (X, Y, Z)."""
        return np.isfinite(self.distances)


def empty_volume(
    resolution: int | tuple[int, int, int] = 64,
    edge: float = 0.3,
    truncation_voxels: float = TRUNCATION_VOXELS,
) -> TsdfVolume:
    """Return a volume that nothing was integrated into.

    Args:
        resolution: Voxels per edge, or along x, y, z; the first spans ``edge``.
        edge: Edge along x in [m].
        truncation_voxels: Truncation in [voxel].

    Raises:
        ConfigError: If a size is not positive.
    """
    shape = (resolution,) * 3 if isinstance(resolution, int) else resolution
    if min(shape) < 1 or not edge > 0 or not truncation_voxels > 0:
        raise ConfigError(
            f"volume needs positive sizes, got {shape} voxels, {edge} m, "
            f"truncation {truncation_voxels} voxels"
        )
    voxel_size = edge / shape[0]
    return TsdfVolume(
        np.full(shape, np.nan, dtype=np.float32),
        np.zeros(shape, dtype=np.uint8),
        voxel_size,
        truncation_voxels * voxel_size,
    )


def integrate(
    volume: TsdfVolume,
    depth: NDArray[np.float32],
    intrinsics: Intrinsics,
    T_task_camera: FloatArray,
    *,
    decay: bool = False,
) -> TsdfVolume:
    """Fuse one depth image into a volume.

    Per voxel centre: ``sdf = (depth - z_camera) * |ray| / z_camera`` at the nearest
    pixel, skipped if ``sdf <= -truncation``; the stored value is the weighted mean of
    ``min(1, sdf / truncation)`` over the views (method sheet, a9).

    Args:
        volume: The volume so far.
        depth: Distance along the optical axis in [m], shape (H, W); anything not
            finite or not positive is not measured.
        intrinsics: The camera.
        T_task_camera: Camera pose, shape (4, 4).
        decay: Let a view that sees at least half a truncation in front of an old
            surface replace it, so that a removed object leaves no ghost.

    Returns:
        A new volume; the given one is left alone.

    Raises:
        ShapeError: If the image does not have the size of the intrinsics.
    """
    if depth.shape != (intrinsics.height, intrinsics.width):
        raise ShapeError(
            "depth", f"({intrinsics.height}, {intrinsics.width})", depth.shape
        )
    distances, weights = volume.distances.copy(), volume.weights.copy()
    T_camera_task = invert(np.asarray(T_task_camera, dtype=np.float64))
    camera = np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy])
    _integrate(
        distances,
        weights,
        np.ascontiguousarray(depth, dtype=np.float32),
        camera,
        T_camera_task,
        volume.voxel_size,
        volume.truncation,
        decay,
    )
    return TsdfVolume(
        distances,
        weights,
        volume.voxel_size,
        volume.truncation,
        volume.view_count + 1,
    )


@njit(cache=True, nogil=True, fastmath={"contract", "arcp"})
def _integrate(  # noqa: PLR0913 (a numba kernel)
    distances, weights, depth, camera, T, voxel_size, truncation, decay
):  # pragma: no cover - compiled
    fx, fy, cx, cy = camera
    height, width = depth.shape
    nx, ny, nz = distances.shape
    for i in range(nx):
        for j in range(ny):
            x0, y0 = (i + 0.5) * voxel_size, (j + 0.5) * voxel_size
            for k in range(nz):
                z0 = (k + 0.5) * voxel_size
                z = T[2, 0] * x0 + T[2, 1] * y0 + T[2, 2] * z0 + T[2, 3]
                if z <= 0:
                    continue
                x = T[0, 0] * x0 + T[0, 1] * y0 + T[0, 2] * z0 + T[0, 3]
                y = T[1, 0] * x0 + T[1, 1] * y0 + T[1, 2] * z0 + T[1, 3]
                u = int(np.floor(fx * x / z + cx + 0.5))
                v = int(np.floor(fy * y / z + cy + 0.5))
                if u < 0 or v < 0 or u >= width or v >= height:
                    continue
                d = depth[v, u]
                if not (d > 0 and d < np.inf):
                    continue
                sdf = (d - z) * np.sqrt(x * x + y * y + z * z) / z
                if sdf <= -truncation:
                    continue
                new = min(1.0, sdf / truncation)
                weight = weights[i, j, k]
                if weight == 0 or (decay and new - distances[i, j, k] > 0.5):
                    distances[i, j, k] = new
                    weights[i, j, k] = 1
                else:
                    old = distances[i, j, k]
                    distances[i, j, k] = (old * weight + new) / (weight + 1)
                    weights[i, j, k] = min(255, weight + 1)


def seen_surface(volume: TsdfVolume) -> tuple[FloatArray, FloatArray]:
    """Extract the observed surface: zero crossings between neighbouring voxels.

    Args:
        volume: A volume with at least one view.

    Returns:
        Points in the task frame in [m] (N, 3) and outward unit normals (N, 3), from
        the distances' gradient.

    Raises:
        EmptySceneError: If no image was integrated.
    """
    if volume.view_count == 0:
        raise EmptySceneError("no depth image was integrated into the volume")
    near = np.count_nonzero(np.abs(volume.distances) < 1)
    points, normals = _seen_surface(volume.distances, near)
    return points * volume.voxel_size, normals


@njit(cache=True, nogil=True)
def _seen_surface(grid, near):  # pragma: no cover - compiled
    """Return the crossings in [voxel] and the unit gradients there."""
    found = np.empty((3, near, 3), dtype=np.int32)
    counts = np.zeros(3, dtype=np.int64)
    nx, ny, nz = grid.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                low = grid[i, j, k]
                if not abs(low) < 1:
                    continue
                for axis in range(3):
                    a, b, c = i + (axis == 0), j + (axis == 1), k + (axis == 2)
                    if a == nx or b == ny or c == nz:
                        continue
                    high = grid[a, b, c]
                    if abs(high) < 1 and low * high <= 0:
                        row = found[axis, counts[axis]]
                        row[0], row[1], row[2] = i, j, k
                        counts[axis] += 1
    points, normals = np.empty((counts.sum(), 3)), np.empty((counts.sum(), 3))
    count = 0
    for axis in range(3):
        for n in range(counts[axis]):
            i, j, k = found[axis, n]
            point, normal = points[count], normals[count]
            count += _crossing(grid, i, j, k, axis, point, normal)
    return points[:count], normals[:count]


@njit(cache=True, nogil=True)
def _crossing(grid, i, j, k, axis, point, normal):  # pragma: no cover - compiled
    """Write down the crossing behind a voxel; False where it faces nowhere."""
    a, b, c = i + (axis == 0), j + (axis == 1), k + (axis == 2)
    low, high = grid[i, j, k], grid[a, b, c]
    x0, y0, z0 = _gradient(grid, i, j, k)
    x1, y1, z1 = _gradient(grid, a, b, c)
    x, y, z = x0 + x1, y0 + y1, z0 + z1
    length = np.sqrt(x * x + y * y + z * z)
    if not length > 1e-6:
        return False
    normal[0], normal[1], normal[2] = x / length, y / length, z / length
    point[0], point[1], point[2] = i + 0.5, j + 0.5, k + 0.5
    point[axis] += 0.5 if low == high else low / (low - high)
    return True


@njit(cache=True, nogil=True)
def _gradient(grid, i, j, k):  # pragma: no cover - compiled
    """Return the differences across a voxel along x, y and z."""
    nx, ny, nz = grid.shape
    i0, i1 = max(i - 1, 0), min(i + 1, nx - 1)
    j0, j1 = max(j - 1, 0), min(j + 1, ny - 1)
    k0, k1 = max(k - 1, 0), min(k + 1, nz - 1)
    x = (_inside(grid[i1, j, k]) - _inside(grid[i0, j, k])) / max(i1 - i0, 1)
    y = (_inside(grid[i, j1, k]) - _inside(grid[i, j0, k])) / max(j1 - j0, 1)
    z = (_inside(grid[i, j, k1]) - _inside(grid[i, j, k0])) / max(k1 - k0, 1)
    return x, y, z


@njit(cache=True, nogil=True)
def _inside(value):  # pragma: no cover - compiled
    """Return a distance; what was never seen counts as inside."""
    return value if np.isfinite(value) else np.float32(-1)
