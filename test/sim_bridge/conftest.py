# SPDX-License-Identifier: Apache-2.0
import pytest

from neugrasp_ros.robot.model import load_robot
from sim_bridge.bridge_world import BridgeScenes
from sim_bridge.robot_cell import (
    StanceRule,
    draw_stance,
    robot_controllers,
    robot_setup,
)
from sim_bridge.robot_world import RobotWorld
from sim_bridge.world import World


@pytest.fixture
def make_world():
    worlds = []

    def make(**options):
        worlds.append(World(**options))
        worlds[-1].load_table()
        return worlds[-1]

    yield make
    for world in worlds:
        world.close()


@pytest.fixture(scope="session")
def tiago():
    return load_robot("tiago_dual")


@pytest.fixture(scope="session")
def cell(tiago):
    """A whole robot at furniture, in lockstep, from drawn viewpoints."""
    rule = StanceRule(random_view=True)
    controllers, limits = robot_controllers(tiago)
    world = RobotWorld(
        robot_setup(tiago),
        controllers,
        limits,
        lambda furniture, seed: draw_stance(tiago, furniture, seed, rule),
        BridgeScenes(),
        0.0,
        lockstep=True,
    )
    yield world
    world.close()
