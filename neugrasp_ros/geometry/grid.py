# SPDX-License-Identifier: Apache-2.0
"""A scalar field on a regular grid: trilinear lookup, gradient, and ray marching.

The grid lies in the task frame: value (i, j, k) belongs to the point
``(i + 0.5, j + 0.5, k + 0.5) * spacing``. Outside the outermost samples a field is
continued constantly. Positive values are inside of things.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.grid_skips import GAP_CELL, inside_gaps, occupied_blocks

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class ScalarGrid:
    """A sampled scalar field, positive inside.

    Attributes:
        values: Samples, shape (X, Y, Z).
        spacing: Distance of neighbouring samples in [m].
        normal_reach: How far to both sides normals compare values in [m]; 0 = as far
            as the next sample.
    """

    values: Float32Array
    spacing: float
    normal_reach: float = 0.0

    def __post_init__(self) -> None:
        """Make the samples contiguous.

        Raises:
            ShapeError: If they are not a three-dimensional grid of at least two
                samples along each axis.
        """
        if self.values.ndim != 3 or min(self.values.shape) < 2:
            raise ShapeError("values", "(X, Y, Z), each >= 2", self.values.shape)
        values = np.ascontiguousarray(self.values, dtype=np.float32)
        object.__setattr__(self, "values", values)

    @property
    def reach(self) -> float:
        """Half the distance over which normals compare values in [m]."""
        return self.normal_reach or self.spacing

    @property
    def size(self) -> FloatArray:
        """Edge lengths in [m], shape (3,)."""
        return np.array(self.values.shape) * self.spacing

    @cached_property
    def gaps(self) -> NDArray[np.uint8]:
        """How far the inside is from each cell, see ``inside_gaps``."""
        return inside_gaps(self.values)

    @cached_property
    def blocks(self) -> NDArray[np.bool_]:
        """Which blocks hold the inside or are near it, see ``occupied_blocks``."""
        return occupied_blocks(self.values)

    def sample(self, points: FloatArray) -> Float32Array:
        """Interpolate trilinearly at points (..., 3) in [m]; shape (...)."""
        flat = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        out = np.empty(len(flat), dtype=np.float32)
        _sample_many(self.values, 1.0 / self.spacing, flat, out)
        return out.reshape(np.shape(points)[:-1])

    def normals(self, points: FloatArray) -> FloatArray:
        """Return outward unit normals at points (N, 3): the negative gradient.

        Central differences over twice ``reach``; where the field is flat the normal is
        zero.
        """
        points = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        out = np.empty((len(points), 3))
        _normals(self.values, 1.0 / self.spacing, self.reach, points, out)
        return out


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="neugrasp-kernel")


def march(
    grid: ScalarGrid,
    origins: FloatArray,
    directions: FloatArray,
    *,
    step: float | None = None,
    box: tuple[FloatArray, FloatArray] | None = None,
    threads: int = 1,
) -> FloatArray:
    """Find where rays enter the inside of the field.

    Rays are clipped to the grid's box and sampled every ``step``; the first sign
    change from free to inside is refined by eight secant steps on the interpolated
    field (method sheet, d2). A ray that starts inside gives nothing.

    Args:
        grid: The field.
        origins: Ray origins in [m], shape (R, 3).
        directions: Unit directions, shape (R, 3).
        step: Sampling step in [m]; default half the grid spacing.
        box: Lower and upper corner in [m] of the part of the grid that is looked at.
        threads: Worker threads.

    Returns:
        Distances along the rays in [m], shape (R,); NaN where nothing is met.

    Raises:
        ShapeError: If origins and directions are not both (R, 3).
    """
    origins = np.ascontiguousarray(origins, dtype=np.float64)
    directions = np.ascontiguousarray(directions, dtype=np.float64)
    if origins.ndim != 2 or origins.shape != directions.shape or origins.shape[1] != 3:
        raise ShapeError("origins and directions", "two (R, 3)", directions.shape)
    out = np.full(len(origins), np.nan)
    gaps = grid.gaps
    low, high = (np.zeros(3), grid.size) if box is None else box
    step = grid.spacing / 2 if step is None else step

    def run(part: slice) -> None:
        _march_many(
            grid.values,
            gaps,
            1.0 / grid.spacing,
            origins[part],
            directions[part],
            low,
            high,
            step,
            out[part],
        )

    run_in_parts(run, len(origins), threads)
    return out


def run_in_parts(run: Callable[[slice], None], count: int, threads: int) -> None:
    """Call ``run(slice)`` on contiguous parts of ``range(count)``, one per thread."""
    if threads <= 1 or count < 64:
        run(slice(0, count))
        return
    edges = np.linspace(0, count, threads + 1).astype(int)
    parts = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    list(_pool(threads).map(run, parts))


MISS = -1.0  # what kernels say of a ray that meets nothing: fast maths knows no NaN


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True, inline="always")
def sample_at(values, u, v, w):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Interpolate one point, in samples from the first one; a building block."""
    nx, ny, nz = values.shape
    u = min(max(u, 0.0), nx - 1.000001)
    v = min(max(v, 0.0), ny - 1.000001)
    w = min(max(w, 0.0), nz - 1.000001)
    i, j, k = int(u), int(v), int(w)
    fu, fv, fw = u - i, v - j, w - k
    a00 = values[i, j, k] * (1 - fw) + values[i, j, k + 1] * fw
    a01 = values[i, j + 1, k] * (1 - fw) + values[i, j + 1, k + 1] * fw
    a10 = values[i + 1, j, k] * (1 - fw) + values[i + 1, j, k + 1] * fw
    a11 = values[i + 1, j + 1, k] * (1 - fw) + values[i + 1, j + 1, k + 1] * fw
    return (a00 * (1 - fv) + a01 * fv) * (1 - fu) + (a10 * (1 - fv) + a11 * fv) * fu


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True, inline="always")
def sample_one(values, inverse, x, y, z):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Interpolate one point in [m]; a kernel's building block."""
    return sample_at(values, x * inverse - 0.5, y * inverse - 0.5, z * inverse - 0.5)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _sample_many(values, inverse, points, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    for n in range(len(points)):
        out[n] = sample_one(values, inverse, points[n, 0], points[n, 1], points[n, 2])


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def normal_one(  # type: ignore[no-untyped-def]  # noqa: PLR0913 (a numba kernel)
    values, inverse, h, x, y, z, out
):  # pragma: no cover
    """Write the outward unit normal at one point; a kernel's building block."""
    gx = sample_one(values, inverse, x - h, y, z) - sample_one(
        values, inverse, x + h, y, z
    )
    gy = sample_one(values, inverse, x, y - h, z) - sample_one(
        values, inverse, x, y + h, z
    )
    gz = sample_one(values, inverse, x, y, z - h) - sample_one(
        values, inverse, x, y, z + h
    )
    length = np.sqrt(gx * gx + gy * gy + gz * gz) + 1e-12
    out[0], out[1], out[2] = gx / length, gy / length, gz / length


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _normals(values, inverse, h, points, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    for n in range(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        normal_one(values, inverse, h, x, y, z, out[n])


@njit(cache=True, nogil=True, error_model="numpy")
def clip_to_box(  # type: ignore[no-untyped-def]  # noqa: PLR0913 (a numba kernel)
    ox, oy, oz, dx, dy, dz, low, high
):  # pragma: no cover
    """Return the interval of a ray inside an axis-aligned box (empty: start > end)."""
    start, end = 0.0, 1e9
    for axis in range(3):
        o = ox if axis == 0 else (oy if axis == 1 else oz)
        d = dx if axis == 0 else (dy if axis == 1 else dz)
        if abs(d) < 1e-12:
            if o < low[axis] or o > high[axis]:
                return 1.0, 0.0
        else:
            a, b = (low[axis] - o) / d, (high[axis] - o) / d
            start, end = max(start, min(a, b)), min(end, max(a, b))
    return start, end


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True, inline="always")
def way_of(direction):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Return what ``march_one`` leaps along one axis by.

    A ray leaves what a gap promises at ``GAP_CELL * (cell + ahead + turn * gap)``: the
    cells nearer than the gap to its own hold no inside.

    Returns:
        One over the direction, ``turn``, ``ahead``, and what is added to the length of
        the leap: nothing, or very much where the ray does not move along the axis.
    """
    if direction > 1e-9:
        return 1.0 / direction, 1, 0, 0.0
    if direction < -1e-9:
        return 1.0 / direction, -1, 1, 0.0
    return 0.0, 1, 0, 1e9


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True, inline="always")
def gap_cell(at, samples):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Return the cell of ``inside_gaps`` along one axis, of a place in [sample]."""
    return min(max(int(at), 0), samples - 1) // GAP_CELL


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def march_one(  # type: ignore[no-untyped-def]  # noqa: PLR0913 (a numba kernel)
    values, gaps, inverse, ox, oy, oz, dx, dy, dz, start, end, step
):  # pragma: no cover
    """Return the first free-to-inside crossing in [start, end], or ``MISS``.

    Where a gap is not 0 the field is not read: it is not positive there.
    """
    nx, ny, nz = values.shape
    ou, ov, ow = ox * inverse - 0.5, oy * inverse - 0.5, oz * inverse - 0.5
    du, dv, dw = dx * inverse, dy * inverse, dz * inverse
    per_u, turn_u, ahead_u, more_u = way_of(du)
    per_v, turn_v, ahead_v, more_v = way_of(dv)
    per_w, turn_w, ahead_w, more_w = way_of(dw)
    t = start
    u, v, w = ou + t * du, ov + t * dv, ow + t * dw
    a, b, c = gap_cell(u, nx), gap_cell(v, ny), gap_cell(w, nz)
    gap = np.int64(gaps[a, b, c])
    if gap == 0 and sample_at(values, u, v, w) > 0:
        return MISS
    while t < end:
        leap = 0.0
        if gap > 0:
            leap = (GAP_CELL * (a + ahead_u + turn_u * gap) - u) * per_u + more_u
            other = (GAP_CELL * (b + ahead_v + turn_v * gap) - v) * per_v + more_v
            leap = min(leap, other)
            other = (GAP_CELL * (c + ahead_w + turn_w * gap) - w) * per_w + more_w
            leap = min(leap, other)
        leaps = leap > 1e-6
        ahead = t + leap if leaps else min(t + step, end)
        u, v, w = ou + ahead * du, ov + ahead * dv, ow + ahead * dw
        a, b, c = gap_cell(u, nx), gap_cell(v, ny), gap_cell(w, nz)
        gap = np.int64(gaps[a, b, c])
        if not leaps and gap == 0:
            value = sample_at(values, u, v, w)
            if value > 0:
                before = sample_at(values, ou + t * du, ov + t * dv, ow + t * dw)
                low, f_low, high, f_high = t, min(before, -1e-6), ahead, value
                middle = ahead
                for _ in range(8):
                    middle = low - f_low * (high - low) / (f_high - f_low)
                    f = sample_at(
                        values, ou + middle * du, ov + middle * dv, ow + middle * dw
                    )
                    if f > 0:
                        high, f_high = middle, f
                    else:
                        low, f_low = middle, f
                    if abs(f) < 1e-4:
                        break
                return middle
        t = ahead
    return MISS


@njit(cache=True, nogil=True, error_model="numpy")
def _march_many(  # type: ignore[no-untyped-def]  # noqa: PLR0913 (a numba kernel)
    values, gaps, inverse, origins, directions, low, high, step, out
):  # pragma: no cover
    for n in range(len(origins)):
        ox, oy, oz = origins[n, 0], origins[n, 1], origins[n, 2]
        dx, dy, dz = directions[n, 0], directions[n, 1], directions[n, 2]
        start, end = clip_to_box(ox, oy, oz, dx, dy, dz, low, high)
        if start <= end:
            t = march_one(
                values, gaps, inverse, ox, oy, oz, dx, dy, dz, start, end, step
            )
            if t >= 0:
                out[n] = t
