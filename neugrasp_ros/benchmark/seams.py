# SPDX-License-Identifier: Apache-2.0
"""A scene of one cube put where the cubes of a larger workspace meet.

A workspace longer than the network's cube by ``EXTRA_VOXELS`` along x and y is covered
by four cubes that share as little as they may. The scene is moved to its middle, so
that all seams go through it; grasps are moved back.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.protocol import Look, Plan
from neugrasp_ros.benchmark.shots import CUBE
from neugrasp_ros.config import CPU_NETWORK
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.types import GraspSet

EXTRA_VOXELS = 42  # of the 64 of a cube: neighbours share the other 22, 10 cm
VOXELS = CPU_NETWORK.resolution  # other networks would meet off the middle
SHIFT = EXTRA_VOXELS / 2 * CUBE / VOXELS  # [m], along x and y

T_WIDE_TASK: NDArray[np.float64] = translation(SHIFT, SHIFT, 0.0)


def moved_look(look: Look) -> Look:
    """Return what a policy may use, in the frame of the large workspace.

    The truth, which only oracles look at, stays in the task frame.
    """
    view = look.view._replace(T_task_camera=T_WIDE_TASK @ look.view.T_task_camera)
    return look._replace(
        view=view, failed=tuple(T_WIDE_TASK @ pose for pose in look.failed)
    )


def moved_back(plan: Plan) -> Plan:
    """Return an answer in the task frame; the field, which is larger, is left out."""
    return plan._replace(
        grasps=_back(plan.grasps),
        candidates=_back(plan.candidates),
        surface=plan.surface - T_WIDE_TASK[:3, 3],
        field=None,
    )


def _back(grasps: GraspSet) -> GraspSet:
    return replace(grasps, poses=np.linalg.inv(T_WIDE_TASK) @ grasps.poses)
