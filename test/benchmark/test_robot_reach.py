# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.benchmark.robot_reach import (
    CONE,
    FORWARD,
    REGION,
    draw_grasps,
    draw_scene,
    measure,
    slow_reference,
)
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.contact import FREE, SELF
from neugrasp_ros.robot.kinematics import ArmKinematics
from neugrasp_ros.robot.model import load_robot, tcp_from_gripper
from neugrasp_ros.robot.postures import PER_CELL
from sim_bridge.robot_body import RobotBody
from sim_bridge.robot_cell import robot_setup
from sim_bridge.world import World


@pytest.fixture(scope="module")
def robot():
    return load_robot("tiago_dual")


def test_drawn_grasps_are_rigid_in_the_region_and_come_from_above():
    poses = draw_grasps(np.random.default_rng(1), 50)
    turns = poses[:, :3, :3]
    np.testing.assert_allclose(
        turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (50, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
    assert ((poses[:, :3, 3] >= REGION[0]) & (poses[:, :3, 3] <= REGION[1])).all()
    assert (turns[:, :, 2] @ FORWARD >= np.cos(CONE)).all()


def test_a_drawn_scene_stands_on_the_table():
    scene = draw_scene(np.random.default_rng(1))
    assert len(scene.points) > 500 and len(scene.boxes.radii) == 1
    assert scene.points[:, 2].min() >= 0.70 - 1e-9


def test_the_reference_starts_from_all_that_is_stored_and_128_places_in_all(robot):
    slow = slow_reference(robot)
    config = slow.config
    assert min(config.first_starts, config.most_starts, config.retries) >= 128
    for arm in slow.arms.values():
        starts = arm._starts(arm._restarts, np.zeros((0, 8)), None)
        assert np.diff(starts.table.starts).max() <= PER_CELL <= starts.tries
        assert starts.tries == 128 <= len(starts.spare)
        far = np.array(np.eye(4)[None])
        # a corner of the map's box, where no wrist ever was
        wrist = tcp_from_gripper(far)[0, :3, :3] @ starts.wrist
        far[0, :3, 3] = arm._known.origin + 0.02 - wrist
        assert arm.may_reach(far).all()
        assert not ArmKinematics(robot, arm.group).may_reach(far).any()


@pytest.mark.slow
def test_what_is_told_to_be_reachable_is_true_and_nearly_complete(robot):
    found = measure(robot, sets=1, slow_sets=1, seed=3)
    truth = found["truth"]
    assert truth["configurations"] == found["reachable"] > 30
    assert truth["postures"] == 12 * found["reachable"]
    assert truth["position_error_mm"] < 1.0 and truth["rotation_error_mrad"] < 5.0
    assert truth["beyond_limits"] == 0.0
    assert truth["deepest_own_mm"] <= 2.0 and truth["deepest_table_mm"] <= 2.0
    assert found["recall_percent"] > 95.0


def test_the_engine_sees_a_body_in_itself_and_in_a_box(robot):
    with World() as world:
        world.reset()
        body = RobotBody(world, robot_setup(robot), np.eye(4), robot.home)
        assert body.own_depth() == 0.0
        box = world.load_box(np.full(3, 0.1), np.eye(4))
        assert body.depth_in(box) > 0.05
        checker, rng = CollisionChecker(robot), np.random.default_rng(0)
        arms = [k for k, n in enumerate(robot.joint_names) if n.startswith("arm_")]
        own = robot.limits
        q = np.tile(robot.home, (60, 1))
        q[:, arms] = rng.uniform(own.lower[arms], own.upper[arms], (60, len(arms)))
        codes = checker.codes(q)
        depths = []
        for values in q:
            body.place(values)
            depths.append(body.own_depth())
        assert max(np.array(depths)[codes == SELF]) > 0.02
        assert max(np.array(depths)[codes == FREE]) <= 0.002
