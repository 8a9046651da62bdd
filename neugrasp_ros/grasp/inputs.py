# SPDX-License-Identifier: Apache-2.0
"""What a detector is told about each grasp, besides the scene's plane features."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import apply, canonical_gripper
from neugrasp_ros.grasp.hand_sweep import STATIONS, SWEEP_FEATURES, sweep_hands
from neugrasp_ros.grasp.local_view import LocalViews, render_local_views

FloatArray = NDArray[np.float64]
Float32Array = NDArray[np.float32]

LENGTH = 0.05  # [m], lengths are divided by it
DISTANCE_LIMIT = 0.03  # [m], signed distances to the hand are clipped to it
LOGIT_SCALE = 8.0
GRIPPER_FEATURES = 8
POINT_FEATURES = 11  # position 3, normal 3, distances to the hand 4, observed 1
TOKEN_FEATURES = 4 + SWEEP_FEATURES + GRIPPER_FEATURES + 2


class LocalInputs(NamedTuple):
    """Inputs of G grasps, with their poses made canonical first.

    Attributes:
        points_task: Local surface points in the task frame in [m], shape (G, P, 3).
        point_features: Shape (G, P, POINT_FEATURES).
        tokens: One per grasp, shape (G, TOKEN_FEATURES).
        hits: Distinct surface points of each grasp, shape (G,).
    """

    points_task: Float32Array
    point_features: Float32Array
    tokens: Float32Array
    hits: NDArray[np.int32]


def hand_distances(
    points: Float32Array, widths: FloatArray, gripper: Gripper
) -> Float32Array:
    """Return signed distances of points to the hand's boxes and the closing region.

    Args:
        points: In the gripper frame in [m], shape (G, P, 3).
        widths: Jaw openings in [m], shape (G,).
        gripper: The gripper.

    Returns:
        Shape (G, P, 4): left finger, right finger, palm, closing region; positive
        outside, in [m], clipped to 3 cm.
    """
    fixed_centers, halves = gripper.boxes(gripper.max_opening)
    region = np.array(
        [gripper.finger_thickness, gripper.max_opening, gripper.finger_depth]
    )
    centers = np.tile(
        np.vstack([fixed_centers, [0.0, 0.0, -gripper.finger_depth / 2]]),
        (len(points), 1, 1),
    )
    halves = np.tile(np.vstack([halves, region / 2]), (len(points), 1, 1))
    lateral = (np.asarray(widths) + gripper.finger_width) / 2
    centers[:, 0, 1], centers[:, 1, 1] = lateral, -lateral
    halves[:, 3, 1] = np.asarray(widths) / 2
    distances = np.empty((*points.shape[:2], 4), dtype=np.float32)
    _box_distances(
        np.ascontiguousarray(points, dtype=np.float32),
        centers.astype(np.float32),
        halves.astype(np.float32),
        np.float32(DISTANCE_LIMIT),
        distances,
    )
    return distances


@njit(cache=True, nogil=True, fastmath=True)
def _box_distances(points, centers, halves, limit, out):  # type: ignore[no-untyped-def]  # pragma: no cover
    """Write clipped signed distances of points (G, P, 3) to boxes (G, K, 3)."""
    zero = np.float32(0.0)
    for g in range(len(points)):
        for p in range(points.shape[1]):
            for k in range(centers.shape[1]):
                outside, inside = zero, -limit
                for axis in range(3):
                    gap = abs(points[g, p, axis] - centers[g, k, axis])
                    gap -= halves[g, k, axis]
                    inside = max(inside, gap)
                    outside += max(gap, zero) ** 2
                distance = np.sqrt(outside) + min(inside, zero)
                out[g, p, k] = min(max(distance, -limit), limit)


def gripper_features(gripper: Gripper) -> FloatArray:
    """Describe a gripper to the network, shape (GRIPPER_FEATURES,)."""
    lengths = [
        gripper.max_opening,
        gripper.finger_depth,
        gripper.finger_thickness,
        gripper.finger_width,
        *gripper.palm_size,
        gripper.tip_advance,
    ]
    return np.array(lengths) / LENGTH


def observed_at(
    distances: NDArray[np.float32], points_task: FloatArray, voxel: float
) -> NDArray[np.bool_]:
    """Tell which surface points a camera has seen.

    Args:
        distances: The volume in units of truncation, NaN = never observed, (X, Y, Z).
        points_task: Points in the task frame in [m], shape (..., 3).
        voxel: Edge of a voxel in [m].
    """
    last = np.array(distances.shape) - 1
    index = np.clip((points_task / voxel).astype(int), 0, last)
    near = distances[index[..., 0], index[..., 1], index[..., 2]]
    return np.asarray(np.abs(near) < 0.6)


def assemble_inputs(  # noqa: PLR0913 (each is a setting of its own stage)
    field: ScalarGrid,
    distances: NDArray[np.float32],
    T_task_grippers: FloatArray,
    widths: FloatArray,
    gripper: Gripper,
    *,
    n_points: int,
    image_size: int,
    fov: float,
    support_height: float,
    threads: int = 1,
    views: LocalViews | None = None,
) -> tuple[LocalInputs, LocalViews]:
    """Render the local views of grasps and describe each grasp to the network.

    A grasp and its twin, turned half about the approach, give the same inputs.

    Args:
        field: Occupancy logits over the volume.
        distances: The volume's distances, NaN = never observed, shape (X, Y, Z).
        T_task_grippers: Grasp poses, shape (G, 4, 4).
        widths: Jaw openings in [m], shape (G,).
        gripper: The gripper.
        n_points: Surface points per grasp.
        image_size: Rows and columns of a local camera [pixel].
        fov: Field of view of a local camera in [rad].
        support_height: Height of the support plane in the task frame in [m].
        threads: Worker threads.
        views: Local views of the canonical poses, rendered otherwise.

    Returns:
        The inputs, and the local views that they were made from.
    """
    poses = canonical_gripper(T_task_grippers)
    if views is None:
        views = render_local_views(
            field,
            poses,
            gripper,
            n_points=n_points,
            image_size=image_size,
            fov=fov,
            threads=threads,
        )
    sweeps = sweep_hands(
        field, poses, widths, gripper, support_height=support_height, threads=threads
    )
    points_task = apply(poses, views.points.astype(np.float64))
    voxel = float(field.size[0]) / distances.shape[0]
    observed = observed_at(distances, points_task, voxel)
    features = np.concatenate(
        [
            views.points / LENGTH,
            views.normals,
            hand_distances(views.points, widths, gripper) / DISTANCE_LIMIT,
            observed[..., None],
        ],
        axis=-1,
    )
    tokens = _tokens(poses, widths, gripper, sweeps, support_height)
    seen_share = np.stack([views.hits / n_points, observed.mean(axis=1)], axis=1)
    inputs = LocalInputs(
        points_task.astype(np.float32),
        features.astype(np.float32),
        np.concatenate([tokens, seen_share], axis=1).astype(np.float32),
        views.hits,
    )
    return inputs, views


def _tokens(
    poses: FloatArray,
    widths: FloatArray,
    gripper: Gripper,
    sweeps: Float32Array,
    support_height: float,
) -> FloatArray:
    """Pose relative to gravity and table, the sweep, and the gripper, (G, ...)."""
    n_logits = len(STATIONS) + 3
    gravity = -poses[:, 2, :3]  # in the gripper frame
    height = (poses[:, 2, 3:] - support_height) / LENGTH
    hand = gripper_features(gripper)
    hand[0] = 0.0
    geometry = np.tile(hand, (len(poses), 1))
    geometry[:, 0] = np.asarray(widths) / LENGTH
    return np.concatenate(
        [
            gravity,
            height,
            sweeps[:, :n_logits] / LOGIT_SCALE,
            np.clip(sweeps[:, n_logits:] / LENGTH, -1, 3),
            geometry,
        ],
        axis=1,
    )


def mirror_inputs(inputs: LocalInputs) -> LocalInputs:
    """Mirror grasps at their x-z plane: the other finger's view of the mirrored world.

    For augmentation; ``points_task`` stays, since features are read there.
    """
    features, tokens = inputs.point_features.copy(), inputs.tokens.copy()
    features[..., 1] *= -1
    features[..., 4] *= -1
    features[..., [6, 7]] = features[..., [7, 6]]
    tokens[:, 1] *= -1
    left = 4 + len(STATIONS)
    tokens[:, [left, left + 1]] = tokens[:, [left + 1, left]]
    return inputs._replace(point_features=features, tokens=tokens)


def perturbed(
    inputs: LocalInputs,
    rng: np.random.Generator,
    *,
    dropped: float = 0.25,
    jitter: float = 0.0005,
) -> LocalInputs:
    """Take some surface points from each grasp and move the others a little.

    For augmentation: which rays just meet something is chance, and a score should not
    hang on it. What is read at ``points_task`` and the distances to the hand stay.

    Args:
        inputs: As of ``assemble_inputs``: where there are too few distinct points they
            repeat in their order.
        rng: Source of randomness.
        dropped: Greatest share of the distinct points that a grasp loses.
        jitter: Standard deviation of the points' movement along each axis in [m].
    """
    points, features = inputs.points_task.copy(), inputs.point_features.copy()
    rows = np.arange(points.shape[1])
    for g, count in enumerate(distinct_counts(points)):
        kept = np.flatnonzero(rng.random(count) >= rng.uniform(0, dropped))
        if not len(kept):
            continue
        chosen = kept[rows % len(kept)]
        moved = rng.normal(0, jitter / LENGTH, (count, 3)).astype(np.float32)
        points[g], features[g] = points[g, chosen], features[g, chosen]
        features[g, :, :3] += moved[chosen]
    return inputs._replace(points_task=points, point_features=features)


def distinct_counts(points: NDArray[np.floating]) -> NDArray[np.int64]:
    """Count the points of each grasp (G, P, 3) before they repeat, at least 1, (G,)."""
    again = (points == points[:, :1]).all(axis=2)
    again = np.pad(again[:, 1:], ((0, 0), (0, 1)), constant_values=True)
    return np.asarray(again.argmax(axis=1) + 1)
