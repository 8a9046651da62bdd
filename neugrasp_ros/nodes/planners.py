# SPDX-License-Identifier: Apache-2.0
"""Loads the planner for the nodes that need one."""

import logging
import time
from collections.abc import Callable

import numpy as np

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.nodes.settings import DEFAULT_SUPPORT_HEIGHT
from neugrasp_ros.nodes.shared_planner import SharedPlanner

MakePlanner = Callable[[PlannerConfig], SharedPlanner]

EDGE = 0.3  # [m]
TRUNCATION = 0.01875  # [m]
BOX_HALF = np.array([0.02, 0.03, 0.04])  # [m]

_logger = logging.getLogger(__name__)


def load_planner(config: PlannerConfig) -> SharedPlanner:
    """Load the network's weights and the gripper, and try them once.

    Raises:
        CheckpointError: If the weights cannot be used.
        ConfigError: If torch does not have the device here.
        UnknownNameError: If the gripper is not known.
    """
    from neugrasp_ros.pipeline import GraspPlanner  # pulls torch: seconds

    start = time.perf_counter()
    planner = GraspPlanner(config)
    volume = box_volume(planner.resolution)
    scene = planner.encode(volume, 0)
    grasps = planner.sample(scene, support_height=DEFAULT_SUPPORT_HEIGHT, seed=1)
    planner.evaluate(scene, grasps, support_height=DEFAULT_SUPPORT_HEIGHT)
    _logger.info("planner loaded and tried in %.1f s", time.perf_counter() - start)
    return SharedPlanner(planner, config.gripper)


def box_volume(resolution: int) -> TsdfVolume:
    """Return a box on a table in closed form, to try the planner on.

    The first decision of a process compiles code and allocates memory; on this one
    nobody waits.

    Args:
        resolution: Voxels per edge of a 30 cm cube.
    """
    voxel = EDGE / resolution
    axis = (np.arange(resolution) + 0.5) * voxel
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    center = np.array([0.15, 0.15, DEFAULT_SUPPORT_HEIGHT + BOX_HALF[2]])
    outside = np.abs(points - center) - BOX_HALF
    box = np.linalg.norm(np.maximum(outside, 0), axis=-1)
    box += np.minimum(outside.max(axis=-1), 0)
    table = points[..., 2] - DEFAULT_SUPPORT_HEIGHT
    distances = np.clip(np.minimum(box, table) / TRUNCATION, -1, 1)
    seen = distances > -1
    return TsdfVolume(
        np.where(seen, distances, np.nan).astype(np.float32),
        seen.astype(np.uint8),
        voxel,
        TRUNCATION,
        view_count=1,
    )


class OnePlanner:
    """Gives every node of a process the same planner.

    Args:
        load: Makes it, at the first call.
    """

    def __init__(self, load: MakePlanner = load_planner) -> None:
        self._load = load
        self._made: tuple[PlannerConfig, SharedPlanner] | None = None

    def __call__(self, config: PlannerConfig) -> SharedPlanner:
        """Return the planner.

        Raises:
            ConfigError: If it was made with other parameters.
        """
        if self._made is None:
            self._made = (config, self._load(config))
        if self._made[0] != config:
            raise ConfigError(
                "nodes of one process share one planner: give scene_renderer and "
                f"grasp_evaluator the same parameters, got {self._made[0]} and {config}"
            )
        return self._made[1]
