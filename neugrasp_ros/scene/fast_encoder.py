# SPDX-License-Identifier: Apache-2.0
"""The encoder with its ``axis`` stem compiled for the CPU, and its U-Net shared out.

Of a voxel's three channels one at most is not 0, and along a column most voxels are
like their neighbours, free or never observed: a run of them adds the difference of two
rows of the weights' running sums. Same numbers as the stem itself, up to rounding.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray
from torch import Tensor, nn

from neugrasp_ros.geometry.grid import run_in_parts
from neugrasp_ros.scene.encoder import (
    FREE_ABOVE,
    INPUT_CHANNELS,
    KEPT_AXES,
    VoxelEncoder,
    volume_channels,
)
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.scene.workers import shared, torch_threads

Float32Array = NDArray[np.float32]

PLANES = 3  # planes at most that a thread takes through the U-Net together


@torch.no_grad()
def encode_volumes(
    network: SceneNetwork,
    volumes: Sequence[Float32Array],
    device: str = "cpu",
    threads: int = 1,
) -> Tensor:
    """Encode volumes, on a CPU by the compiled stem where the network has that one.

    Args:
        network: The network.
        volumes: As of ``project_columns``.
        device: Torch device of the network.
        threads: Worker threads.

    Returns:
        Feature planes, shape (B, 3, C, R, R).
    """
    encoder: Any = network.encoder
    known = isinstance(encoder, VoxelEncoder) and device == "cpu"
    if not known or not isinstance(encoder.stem, nn.ModuleList):
        channels = np.stack([volume_channels(volume) for volume in volumes])
        with torch_threads(threads):
            return network.encode(torch.from_numpy(channels).to(device))
    planes = project_columns(encoder.stem, volumes, threads).flatten(0, 1)
    n_parts = threads * -(-len(planes) // (threads * PLANES))
    parts = planes.tensor_split(min(n_parts, len(planes)))
    done = torch.cat(shared(encoder.unet, parts, threads))
    return done.unflatten(0, (len(volumes), 3))


@torch.no_grad()
def project_columns(
    stem: Any, volumes: Sequence[Float32Array], threads: int = 1
) -> Tensor:
    """Do what the ``axis`` stem does with the channels of volumes.

    Args:
        stem: One strided convolution for each dropped axis.
        volumes: Distances in units of truncation, NaN = never observed, shapes
            (D, D, D).
        threads: Worker threads.

    Returns:
        Planes after the ReLU, shape (B, 3, C, R, R).
    """
    size = len(volumes[0])
    rows = [_rows(conv, size) for conv in stem]
    biases = [conv.bias.detach().numpy() for conv in stem]
    _, step, _, channels = rows[0].signed.shape
    cells = size // step
    out = np.empty((len(volumes), 3, cells, cells, channels), dtype=np.float32)

    def run(part: slice) -> None:
        for number in range(part.start, part.stop):
            plane, second = divmod(number, cells)
            volume, dropped = divmod(plane, 3)
            first_axis, second_axis = KEPT_AXES[dropped]
            columns = volumes[volume].transpose(dropped, second_axis, first_axis)
            _project_row(
                columns[:, step * second : step * (second + 1)],
                rows[dropped].signed,
                rows[dropped].free_sums,
                rows[dropped].unknown_sums,
                biases[dropped],
                np.float32(FREE_ABOVE),
                out[volume, dropped, second],
            )

    run_in_parts(run, len(volumes) * 3 * cells, threads)
    return torch.from_numpy(out).permute(0, 1, 4, 2, 3).contiguous()


class _Rows(NamedTuple):
    """A convolution's weights, by their place: depth, second, first, output."""

    signed: Float32Array  # (D, S, S, C)
    free_sums: Float32Array  # (D + 1, S, S, C), of all places before
    unknown_sums: Float32Array


def _rows(conv: Any, size: int) -> _Rows:
    weight: Tensor = conv.weight.detach()
    split = weight.unflatten(1, (INPUT_CHANNELS, size)).permute(1, 2, 3, 4, 0)
    signed, free, unknown = (np.ascontiguousarray(w) for w in split.numpy())
    sums = (
        np.concatenate([np.zeros_like(w[:1]), np.cumsum(w, axis=0)])
        for w in (free, unknown)
    )
    return _Rows(signed, *sums)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _project_row(  # noqa: C901, PLR0913 (a kernel)
    columns, signed, free_sums, unknown_sums, bias, free, out
):  # pragma: no cover - compiled
    """Write one row of a plane's cells (R, C) from the voxels (D, S, R * S) over it."""
    depth, step, _ = columns.shape
    channels = out.shape[1]
    for cell in range(len(out)):
        for c in range(channels):
            out[cell, c] = bias[c]
        for second in range(step):
            for first in range(step):
                start, kind = 0, 0  # of the run at hand: 0 none, 1 free, 2 unknown
                for d in range(depth + 1):
                    now, value = 0, np.float32(0.0)
                    if d < depth:
                        value = columns[d, second, step * cell + first]
                        if value != value:
                            now = 2
                        elif value >= free:
                            now = 1
                    if now == kind and kind > 0:
                        continue
                    if kind == 1:
                        for c in range(channels):
                            out[cell, c] += (
                                free_sums[d, second, first, c]
                                - free_sums[start, second, first, c]
                            )
                    elif kind == 2:
                        for c in range(channels):
                            out[cell, c] += (
                                unknown_sums[d, second, first, c]
                                - unknown_sums[start, second, first, c]
                            )
                    start, kind = d, now
                    if now == 0 and d < depth:
                        for c in range(channels):
                            out[cell, c] += value * signed[d, second, first, c]
        for c in range(channels):
            out[cell, c] = max(out[cell, c], np.float32(0.0))
