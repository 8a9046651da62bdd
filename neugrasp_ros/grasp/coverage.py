# SPDX-License-Identifier: Apache-2.0
"""Proposals for what the first round left without any: small, low or crowded things.

Seeds are spread over all that is seen. What can be grasped in few ways may get a few
seeds and no grasp; it is then tried again by itself, with more seeds.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.support import ABOVE_SUPPORT
from neugrasp_ros.grasp.ranking import distinct
from neugrasp_ros.grasp.sampling import Proposals, SamplerConfig, propose

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

NEAR = 0.04  # [m]; a point this near to a TCP, seen from above, has a proposal
BESIDE = 0.04  # [m]; what is this near to a bare point is tried again with it
LEAST_POINTS = 8  # fewer bare points are not tried again
SEED_POINTS = 1000  # surface points that share the usual number of seeds
POINTS_PER_SEED = 4  # where it is tried again
SEEDS = 32, 256  # at least, at most
ROUNDS = 2


def bare_points(
    points: FloatArray, found: Proposals, support_height: float | None
) -> BoolArray:
    """Tell which surface points have no proposal near, seen from above.

    Args:
        points: In the task frame in [m], shape (N, 3).
        found: The proposals.
        support_height: Height of the support plane in [m]; None = there is none.

    Returns:
        Shape (N,); False for the support itself.
    """
    bare = np.ones(len(points), dtype=bool)
    if support_height is not None:
        bare &= points[:, 2] > support_height + ABOVE_SUPPORT
    return bare & ~_near(points[:, :2], found.poses[:, :2, 3], NEAR)


def propose_everywhere(
    points: FloatArray,
    normals: FloatArray,
    gripper: Gripper,
    config: SamplerConfig,
    rng: np.random.Generator,
    *,
    support_height: float | None = None,
) -> Proposals:
    """Propose grasps on a surface of any size, and again where there are none.

    Args:
        points: As of ``sampling.propose``, like the others.
        normals: Outward unit normals.
        gripper: The hand.
        config: Density and limits; a large surface gets more seeds.
        rng: Source of randomness.
        support_height: Height of the support.

    Returns:
        All distinct proposals.
    """
    seeds = round(config.n_seeds * max(1.0, len(points) / SEED_POINTS))
    found = propose(
        points, normals, gripper, replace(config, n_seeds=seeds), rng,
        support_height=support_height,
    )  # fmt: skip
    for _ in range(ROUNDS):
        bare = bare_points(points, found, support_height)
        if bare.sum() < LEAST_POINTS:
            break
        region = _near(points, points[bare], BESIDE)
        seeds = int(np.clip(region.sum() // POINTS_PER_SEED, *SEEDS))
        more = propose(
            points[region], normals[region], gripper, replace(config, n_seeds=seeds),
            rng, support_height=support_height, obstacles=points[~region],
        )  # fmt: skip
        if not len(more.poses):
            break
        both = (np.concatenate(parts) for parts in zip(found, more, strict=True))
        found = Proposals(*both)
        kept = distinct(found.poses, found.scores, config.distance, config.angle)
        found = found.take(kept)
    return found


def _near(points: FloatArray, others: FloatArray, reach: float) -> BoolArray:
    """Tell which points (N, K) are nearer than ``reach`` to one of others (M, K)."""
    if not len(others):
        return np.zeros(len(points), dtype=bool)
    near, _ = cKDTree(others).query(points, distance_upper_bound=reach)
    return np.asarray(np.isfinite(near))
