# SPDX-License-Identifier: Apache-2.0
"""Noise models of depth cameras, as pure functions of an image."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import zoom

FloatArray = NDArray[np.float64]
DepthImage = NDArray[np.float32]

JUMP = 0.02  # depth step between neighbours that counts as an edge [m]
GRAZING = np.deg2rad(80.0)  # incidence beyond which a pixel may drop out [rad]
FIELD_STRIDE = 4  # [pixel], correlated noise is drawn on a grid this much coarser


def _correlated_field(
    shape: tuple[int, int], sigma: float, rng: np.random.Generator
) -> FloatArray:
    coarse = tuple(-(-n // FIELD_STRIDE) + 1 for n in shape)
    field = zoom(rng.normal(0.0, sigma, coarse), FIELD_STRIDE, order=1)
    return np.asarray(field[: shape[0], : shape[1]])


def add_mod_dex(depth: DepthImage, rng: np.random.Generator) -> DepthImage:
    """Apply the ``mod_dex`` noise of the benchmark (method sheet, a9).

    The whole image is scaled by one Gamma(1000, 0.001) draw (3.2 % sd); with
    probability one half a correlated Gaussian field of 5 mm sd is added.

    Args:
        depth: Depth in [m], NaN = nothing, shape (H, W).
        rng: Source of randomness.
    """
    noisy = depth * rng.gamma(1000.0, 0.001)
    if rng.random() < 0.5:
        noisy = noisy + _correlated_field(depth.shape, 0.005, rng)
    return np.asarray(noisy, dtype=np.float32)


def add_camera_noise(
    depth: DepthImage, incidence: FloatArray, rng: np.random.Generator
) -> DepthImage:
    """Apply the noise of a decent RGB-D camera (method sheet, i2).

    Scale N(1, 0.004) for the image, a correlated field of 2 mm sd, 1 mm (z / 0.6 m)^2
    per pixel; pixels at depth jumps above 2 cm or seen at more than 80 degrees drop to
    NaN with probability one half.

    Args:
        depth: Depth in [m], NaN = nothing, shape (H, W).
        incidence: Angle between ray and surface normal in [rad], shape (H, W).
        rng: Source of randomness.
    """
    noisy = depth * rng.normal(1.0, 0.004)
    noisy = noisy + _correlated_field(depth.shape, 0.002, rng)
    noisy = noisy + rng.normal(size=depth.shape) * 0.001 * (depth / 0.6) ** 2
    unsure = incidence > GRAZING
    for axis in (0, 1):
        jump = np.abs(np.diff(np.nan_to_num(depth, nan=1e3), axis=axis)) > JUMP
        before = [(0, 0), (0, 0)]
        after = [(0, 0), (0, 0)]
        before[axis], after[axis] = (1, 0), (0, 1)
        unsure |= np.pad(jump, before) | np.pad(jump, after)
    dropped = unsure & (rng.random(depth.shape) < 0.5)
    return np.where(dropped, np.nan, noisy).astype(np.float32)
