# SPDX-License-Identifier: Apache-2.0
"""The occupancy decoder compiled for the CPU, for points on a grid or anywhere.

What a residual block adds of the features is linear in them, and so is reading a plane
between its cells: each plane is multiplied by the blocks' matrices once, and a point on
a grid then sums three rows, another point twelve. The rest of the decoder runs in tiles
that fit the cache. Same numbers as the decoder itself, up to rounding, at a fraction of
its cost.
"""

from typing import Any, NamedTuple

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import interpolate

from neugrasp_ros.geometry.grid import run_in_parts
from neugrasp_ros.scene.decoder import OccupancyDecoder

Float32Array = NDArray[np.float32]

TILE = 48  # points decoded together: their activations stay in the first cache, and a
# product of this size is too small for OpenBLAS to start threads of its own


class DecoderWeights(NamedTuple):
    """The decoder's matrices, laid out for the kernel; H hidden, K blocks.

    Attributes:
        position: Shape (4, H): x, y, z and bias, for positions in [0, 1].
        first: ``fc0`` of each block, input by output, shape (K, H, H).
        first_bias: Shape (K, H).
        second: ``fc1`` of each block, input by output, shape (K, H, H).
        second_bias: Shape (K, H).
        last: Weights and bias of the logit, shape (H + 1,).
    """

    position: Float32Array
    first: Float32Array
    first_bias: Float32Array
    second: Float32Array
    second_bias: Float32Array
    last: Float32Array


def _array(tensor: Tensor) -> Float32Array:
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=np.float32)


def pack_weights(decoder: OccupancyDecoder) -> DecoderWeights:
    """Lay out a decoder's weights for the kernel."""
    linear = decoder.position
    shift = linear.bias - 0.5 * linear.weight.sum(dim=1)
    blocks: list[Any] = list(decoder.blocks)
    return DecoderWeights(
        _array(torch.cat([linear.weight.T, shift[None]])),
        _array(torch.stack([b.fc0.weight.T for b in blocks])),
        _array(torch.stack([b.fc0.bias for b in blocks])),
        _array(torch.stack([b.fc1.weight.T for b in blocks])),
        _array(torch.stack([b.fc1.bias for b in blocks])),
        _array(torch.cat([decoder.logit.weight[0], decoder.logit.bias])),
    )


@torch.no_grad()
def project_planes(decoder: OccupancyDecoder, planes: Tensor) -> Float32Array:
    """Multiply planes by the blocks' feature matrices, at their own resolution.

    Args:
        decoder: The decoder.
        planes: Planes of one scene, shape (1, 3, C, R, R).

    Returns:
        Shape (3, R, R, K * H), indexed like the planes; the biases are in the first.
    """
    layers: list[Any] = list(decoder.injections)
    weights = torch.stack([layer.weight for layer in layers])  # (K, H, 3C)
    biases = torch.stack([layer.bias for layer in layers])
    channels, size = planes.shape[2], planes.shape[-1]
    split = weights.flatten(0, 1).unflatten(1, (3, channels))  # (K * H, 3, C)
    flat = planes[0].flatten(2).transpose(1, 2)  # (3, R * R, C)
    projected = torch.bmm(flat, split.permute(1, 2, 0))
    projected[0] += biases.flatten()
    return _array(projected.unflatten(1, (size, size)))


def at_resolution(
    table: Float32Array, resolution: int, threads: int = 1
) -> Float32Array:
    """Interpolate projected planes (3, R, R, F) to a grid's columns.

    Args:
        table: Of ``project_planes``.
        resolution: Samples per edge of the grid, R or more.
        threads: Worker threads.

    Returns:
        Shape (3, resolution, resolution, F).
    """
    size, features = table.shape[1], table.shape[3]
    if resolution == size:
        return table
    if resolution != 2 * size:
        flat = torch.from_numpy(table).permute(0, 3, 1, 2)
        flat = interpolate(flat, size=(resolution,) * 2, mode="bilinear")
        return _array(flat.permute(0, 2, 3, 1))
    out = np.empty((3, resolution, resolution, features), dtype=np.float32)

    def run(part: slice) -> None:
        _double_rows(table, part.start, part.stop, out)

    run_in_parts(run, 3 * resolution, threads)
    return out


def decode_on_grid(
    weights: DecoderWeights,
    projected: Float32Array,
    index: NDArray[np.int64],
    threads: int = 1,
) -> Float32Array:
    """Decode occupancy at grid samples.

    Args:
        weights: Of ``pack_weights``.
        projected: Of ``at_resolution``, at the grid's.
        index: Samples (i, j, k) along x, y, z, shape (N, 3).
        threads: Worker threads.

    Returns:
        Logits, shape (N,).
    """
    scale = np.float32(1.0 / projected.shape[1])
    points = (np.asarray(index, dtype=np.float32) + np.float32(0.5)) * scale
    return _decode_all(weights, projected, points, True, threads)


def decode_at_points(
    weights: DecoderWeights,
    projected: Float32Array,
    points: NDArray[np.floating],
    threads: int = 1,
) -> Float32Array:
    """Decode occupancy anywhere.

    Args:
        weights: Of ``pack_weights``.
        projected: Of ``project_planes``.
        points: In units of the cube's edge, shape (N, 3); beyond the cube the border's
            features are read.
        threads: Worker threads.

    Returns:
        Logits, shape (N,).
    """
    return _decode_all(weights, projected, points.astype(np.float32), False, threads)


def _decode_all(
    weights: DecoderWeights,
    projected: Float32Array,
    points: Float32Array,
    on_grid: bool,
    threads: int,
) -> Float32Array:
    points = np.ascontiguousarray(points)
    out = np.empty(len(points), dtype=np.float32)

    def run(part: slice) -> None:
        _decode(*weights, projected, points[part], on_grid, out[part])

    run_in_parts(run, len(points), threads)
    return out


@njit(cache=True, nogil=True, fastmath=True)
def _double_rows(table, first, last, out):  # pragma: no cover - compiled
    """Interpolate rows, counted over all planes, bilinearly between cell centres."""
    _, size, _, features = table.shape
    near, far = np.float32(0.75), np.float32(0.25)
    for row in range(first, last):
        p, i = row // (2 * size), row % (2 * size)
        a = i // 2
        b = min(max(a + 2 * (i % 2) - 1, 0), size - 1)
        for j in range(2 * size):
            c = j // 2
            d = min(max(c + 2 * (j % 2) - 1, 0), size - 1)
            for f in range(features):
                along = near * table[p, a, c, f] + far * table[p, a, d, f]
                beside = near * table[p, b, c, f] + far * table[p, b, d, f]
                out[p, i, j, f] = near * along + far * beside


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _at_cells(table, u, v, w, base, out, n):  # pragma: no cover - compiled
    """Write ``base`` (F,) and three planes' rows, of the cells of a point, to row n.

    The table is indexed [plane, second, first], as planes are.
    """
    size = table.shape[1]
    i, j, k = int(u * size), int(v * size), int(w * size)
    for f in range(out.shape[1]):
        out[n, f] = base[f] + table[0, k, j, f] + table[1, k, i, f] + table[2, j, i, f]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _between_cells(table, p, first, second, out, n):  # pragma: no cover - compiled
    """Add a plane's row at coordinates in [0, 1], between four cells, to row n."""
    size = table.shape[1]
    u, v = first * size, second * size
    u = min(max(u - np.float32(0.5), np.float32(0.0)), np.float32(size - 1))
    v = min(max(v - np.float32(0.5), np.float32(0.0)), np.float32(size - 1))
    i, j = int(u), int(v)
    k, m = min(i + 1, size - 1), min(j + 1, size - 1)
    a, b = np.float32(u - i), np.float32(v - j)
    both = a * b
    near, far, near_up = np.float32(1.0) - a - b + both, a - both, b - both
    for f in range(out.shape[1]):
        low = near * table[p, j, i, f] + far * table[p, j, k, f]
        high = near_up * table[p, m, i, f] + both * table[p, m, k, f]
        out[n, f] += low + high


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _gather(table, points, start, count, on_grid, base, out):  # pragma: no cover
    """Write what points read off three planes, and ``base`` (F,), to rows (N, F)."""
    for n in range(count):
        i = start + n
        u, v, w = points[i, 0], points[i, 1], points[i, 2]
        if on_grid:
            _at_cells(table, u, v, w, base, out, n)
        else:
            out[n] = base
            _between_cells(table, 0, v, w, out, n)
            _between_cells(table, 1, u, w, out, n)
            _between_cells(table, 2, u, v, out, n)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _decode(  # noqa: C901, PLR0913 (a numba kernel)
    position, first, first_bias, second, second_bias, last, projected, points, on_grid,
    out,
):  # fmt: skip  # pragma: no cover - compiled
    n_blocks, hidden, _ = first.shape
    zero = np.float32(0.0)
    x = np.empty((TILE, hidden), dtype=np.float32)
    y = np.empty((TILE, hidden), dtype=np.float32)
    z = np.empty((TILE, hidden), dtype=np.float32)
    flat_z = z.reshape(-1)
    added = np.empty((TILE, n_blocks * hidden), dtype=np.float32)
    base = np.empty(n_blocks * hidden, dtype=np.float32)  # what blocks add anyway
    shift = np.empty((n_blocks, TILE * hidden), dtype=np.float32)
    for b in range(n_blocks):
        for h in range(hidden):
            base[b * hidden + h] = second_bias[b - 1, h] if b > 0 else position[3, h]
        for n in range(TILE):
            shift[b, n * hidden : (n + 1) * hidden] = first_bias[b]
    for start in range(0, len(points), TILE):
        count = min(TILE, len(points) - start)
        _gather(projected, points, start, count, on_grid, base, added)
        for n in range(count):
            i = start + n
            u, v, w = points[i, 0], points[i, 1], points[i, 2]
            for h in range(hidden):
                x[n, h] = u * position[0, h] + v * position[1, h] + w * position[2, h]
                y[n, h] = zero
        for b in range(n_blocks):
            for n in range(count):
                offset = b * hidden
                for h in range(hidden):
                    x[n, h] += added[n, offset + h] + y[n, h]
                    y[n, h] = max(x[n, h], zero)
            np.dot(y[:count], first[b], z[:count])
            for i in range(count * hidden):
                flat_z[i] = max(flat_z[i] + shift[b, i], zero)
            np.dot(z[:count], second[b], y[:count])
        for n in range(count):
            total = last[hidden]
            for h in range(hidden):
                value = x[n, h] + y[n, h] + second_bias[n_blocks - 1, h]
                total += max(value, zero) * last[h]
            out[start + n] = total


@njit(cache=True, nogil=True, error_model="numpy", fastmath=True)
def _read(table, points, base, out):  # pragma: no cover - compiled
    _gather(table, points, 0, len(points), False, base, out)


def read_projected(
    table: Float32Array, points: Float32Array, threads: int = 1
) -> Float32Array:
    """Sum the rows of three projected planes at points, bilinearly on each.

    Args:
        table: Planes multiplied by a matrix, shape (3, R, R, F), indexed like planes.
        points: In units of the cube's edge, shape (N, 3); beyond the cube the border's
            row is read.
        threads: Worker threads.

    Returns:
        Shape (N, F).
    """
    points = np.ascontiguousarray(points, dtype=np.float32)
    out = np.empty((len(points), table.shape[-1]), dtype=np.float32)
    base = np.zeros(table.shape[-1], dtype=np.float32)

    def run(part: slice) -> None:
        _read(table, points[part], base, out[part])

    run_in_parts(run, len(points), threads)
    return out
