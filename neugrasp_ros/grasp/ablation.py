# SPDX-License-Identifier: Apache-2.0
"""What a detector is told when it may not look at the local surface.

For ablations: the same network and the same grasps, with less to go by.
"""

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.geometry.transform import apply, canonical_gripper
from neugrasp_ros.grasp.hand_sweep import SWEEP_FEATURES
from neugrasp_ros.grasp.inputs import (
    GRIPPER_FEATURES,
    LENGTH,
    POINT_FEATURES,
    TOKEN_FEATURES,
    LocalInputs,
)

FloatArray = NDArray[np.float64]

RENDERED, GRID, CENTRE = "rendered", "grid", "centre"
LOCAL_VIEWS = (RENDERED, GRID, CENTRE)

GRID_SHAPE = (4, 8, 4)  # points along x, y and z: as many as local surface points
GRID_LOWER = np.array([-0.015, -0.05, -0.05])  # [m], in the gripper frame
GRID_UPPER = np.array([0.015, 0.05, 0.01])  # [m]
AXES_COLUMNS = (0, 2, 3, 5, 8, 9)  # of the point features: mirroring leaves them alone
GRIPPER_COLUMNS = slice(4 + SWEEP_FEATURES, 4 + SWEEP_FEATURES + GRIPPER_FEATURES)


def restricted_inputs(
    inputs: LocalInputs,
    T_task_grippers: FloatArray,
    local_view: str,
    unit: float = 1.0,
) -> LocalInputs:
    """Take away what a local view shows, and leave what can be known without it.

    ``rendered`` keeps everything. ``grid`` (no local rendering) reads the plane
    features at fixed points between the jaws instead of on a rendered surface.
    ``centre`` reads them at the TCP alone and is told the orientation, as in GIGA.
    Neither is told what the swept hand meets, or how much of it was seen; the
    gripper's measures stay.

    Args:
        inputs: Inputs of G grasps.
        T_task_grippers: Their poses, shape (G, 4, 4).
        local_view: One of ``LOCAL_VIEWS``.
        unit: What 1 of ``points_task`` is, in [m].

    Raises:
        UnknownNameError: If there is no such view.
    """
    if local_view not in LOCAL_VIEWS:
        raise UnknownNameError("local view", local_view, LOCAL_VIEWS)
    if local_view == RENDERED:
        return inputs
    poses = canonical_gripper(T_task_grippers)
    points = _grid() if local_view == GRID else np.zeros((1, 3))
    features = np.zeros((len(poses), len(points), POINT_FEATURES), dtype=np.float32)
    if local_view == GRID:
        features[..., :3] = points / LENGTH
    else:
        axes = np.concatenate([poses[:, :3, 2], poses[:, :3, 1]], axis=1)
        features[..., AXES_COLUMNS] = axes[:, None]
    tokens = np.zeros((len(poses), TOKEN_FEATURES), dtype=np.float32)
    tokens[:, GRIPPER_COLUMNS] = inputs.tokens[:, GRIPPER_COLUMNS]
    if local_view == GRID:
        tokens[:, :4] = inputs.tokens[:, :4]  # gravity and height
    spread = np.broadcast_to(points, (len(poses), *points.shape))
    points_task = np.asarray(apply(poses, spread) / unit, dtype=np.float32)
    return LocalInputs(points_task, features, tokens, inputs.hits)


def _grid() -> FloatArray:
    """Return the points between the jaws in the gripper frame in [m], shape (P, 3)."""
    axes = [
        np.linspace(low, high, count)
        for low, high, count in zip(GRID_LOWER, GRID_UPPER, GRID_SHAPE, strict=True)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
