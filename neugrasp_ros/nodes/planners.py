# SPDX-License-Identifier: Apache-2.0
"""Loads the planner for the nodes that need one."""

from collections.abc import Callable

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.nodes.planner_stages import SharedPlanner

MakePlanner = Callable[[PlannerConfig], SharedPlanner]


def load_planner(config: PlannerConfig) -> SharedPlanner:
    """Load the network's weights and the gripper.

    Raises:
        CheckpointError: If the weights cannot be used.
        UnknownNameError: If the gripper is not known.
    """
    from neugrasp_ros.pipeline import GraspPlanner  # pulls torch: seconds

    return SharedPlanner(GraspPlanner(config), config.gripper)


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
