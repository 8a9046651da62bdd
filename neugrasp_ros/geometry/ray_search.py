# SPDX-License-Identifier: Apache-2.0
"""Rays against an occupancy that can only be asked point by point: slow and literal.

The yardstick of the fast ray marcher (``grid.march``), which works on samples.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

Occupancy = Callable[[FloatArray], Float32Array]
"""Points (N, 3) in [m] in, probabilities of being occupied (N,) out."""

RAYS_AT_ONCE = 4096  # bounds the memory: 4096 rays of 256 samples are 25 MB


def first_crossings(
    occupancy: Occupancy,
    origins: FloatArray,
    directions: FloatArray,
    samples: FloatArray,
    secant_steps: int = 8,
) -> FloatArray:
    """Find where rays enter what is occupied (method sheet, d2).

    Every sample of every ray is asked. A ray counts if its first sample is free and its
    first change is from free to occupied; with f = probability - 1/2, each secant step
    goes to ``d = a - f(a) (b - a) / (f(b) - f(a))`` and replaces the end of its sign.

    Args:
        occupancy: The occupancy.
        origins: Ray origins in [m], shape (R, 3).
        directions: Unit directions, shape (R, 3).
        samples: Distances along the rays that are looked at in [m], rising, (S,).
        secant_steps: How often the crossing is refined.

    Returns:
        Distances along the rays in [m], shape (R,); NaN where nothing is met.
    """
    parts = [
        _crossings(
            occupancy,
            origins[start : start + RAYS_AT_ONCE],
            directions[start : start + RAYS_AT_ONCE],
            samples,
            secant_steps,
        )
        for start in range(0, len(origins), RAYS_AT_ONCE)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


def _crossings(
    occupancy: Occupancy,
    origins: FloatArray,
    directions: FloatArray,
    samples: FloatArray,
    secant_steps: int,
) -> FloatArray:
    points = origins[:, None] + samples[:, None] * directions[:, None]  # (R, S, 3)
    f = occupancy(points.reshape(-1, 3)).reshape(points.shape[:2]) - 0.5
    inside = f > 0
    enters = ~inside[:, :-1] & inside[:, 1:]
    hit = np.flatnonzero(~inside[:, 0] & enters.any(axis=1))
    step = enters[hit].argmax(axis=1)
    low, high = samples[step], samples[step + 1]
    f_low, f_high = (f[hit, s].astype(np.float64) for s in (step, step + 1))
    for _ in range(secant_steps):
        middle = low - f_low * (high - low) / (f_high - f_low)
        there = origins[hit] + middle[:, None] * directions[hit]
        f_middle = occupancy(there).astype(np.float64) - 0.5
        outer = f_middle <= 0
        low, f_low = np.where(outer, middle, low), np.where(outer, f_middle, f_low)
        high, f_high = np.where(outer, high, middle), np.where(outer, f_high, f_middle)
    found = np.full(len(origins), np.nan)
    found[hit] = low - f_low * (high - low) / (f_high - f_low)
    return found


def outward_normals(
    depth: Callable[[FloatArray], Float32Array], points: FloatArray, reach: float
) -> FloatArray:
    """Return outward unit normals: central differences of a function.

    Args:
        depth: Points (N, 3) in, values (N,) that rise inwards out.
        points: Where, in [m], shape (N, 3).
        reach: Half the distance of the two points compared along each axis in [m].

    Returns:
        Shape (N, 3); zero where the function is flat.
    """
    offsets = reach * np.concatenate([np.eye(3), -np.eye(3)])
    around = (points[:, None] + offsets).reshape(-1, 3)
    values = depth(around).reshape(-1, 2, 3).astype(np.float64)
    gradient = values[:, 0] - values[:, 1]
    length = np.linalg.norm(gradient, axis=1, keepdims=True)
    return np.asarray(-gradient / np.maximum(length, 1e-12))


def refine_crossings(
    depth: Callable[[FloatArray], Float32Array],
    points: FloatArray,
    directions: FloatArray,
    reach: float,
    steps: int = 3,
) -> FloatArray:
    """Move points along lines to where a function changes its sign.

    The first guess is the points' own place; then the Illinois variant of the secant.

    Args:
        depth: Points (N, 3) in, values (N,) out, positive inside.
        points: Points near the surface in [m], shape (N, 3).
        directions: Unit directions that lead inside, shape (N, 3).
        reach: How far the surface is looked for to both sides in [m].
        steps: Secant steps.

    Returns:
        Points on the surface, shape (N, 3); those that do not bracket it stay.
    """
    low, high = np.full(len(points), -reach), np.full(len(points), reach)
    f_low = depth(points + low[:, None] * directions).astype(np.float64)
    f_high = depth(points + high[:, None] * directions).astype(np.float64)
    bracket = (f_low < 0) & (f_high > 0)
    at = np.zeros(len(points))
    kept = np.zeros(len(points))  # which end stayed last: -1 the lower, 1 the upper
    for _ in range(steps):
        f = depth(points + at[:, None] * directions).astype(np.float64)
        outer = f <= 0
        low, high = np.where(outer, at, low), np.where(outer, high, at)
        f_high = np.where(outer, f_high * np.where(kept == 1, 0.5, 1), f)
        f_low = np.where(outer, f, f_low * np.where(kept == -1, 0.5, 1))
        kept = np.where(outer, 1, -1)
        slope = np.where(bracket, f_high - f_low, 1.0)
        at = np.where(bracket, low - f_low * (high - low) / slope, 0.0)
    return np.asarray(points + at[:, None] * directions)
