# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from neugrasp_ros.errors import RobotModelError, ShapeError
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.contact import FREE, HAND, SCENE, SELF
from neugrasp_ros.robot.model import RobotModel
from neugrasp_ros.robot.obstacles import SolidBox, make_obstacles

LEFT, RIGHT = "arm_left_torso", "arm_right_torso"


def at(position):
    T = np.eye(4)
    T[:3, 3] = position
    return T


@pytest.fixture(scope="module")
def samples(robot):
    rng = np.random.default_rng(3)
    limits = robot.limits
    return rng.uniform(limits.lower, limits.upper, (300, len(limits.lower)))


def test_the_resting_posture_touches_nothing(robot, collisions):
    assert collisions.first_contact(robot.home) is None


def test_an_arm_folded_into_the_chest_is_self_collision(robot, collisions):
    q = robot.home.copy()
    for joint, value in zip(range(1, 5), (-1.1, -1.1, 0.0, 2.3), strict=True):
        q[robot.joint_names.index(f"arm_left_{joint}_joint")] = value
    assert collisions.codes(q[None])[0] == SELF
    assert set(collisions.first_contact(q)) == {"torso_lift_link", "arm_left_5_link"}


def test_answers_equal_those_of_pinocchio(robot, collisions, samples):
    model, data = robot.engine.model, robot.engine.data
    geometry = robot.engine.geometry.copy()
    for i, j in collisions.pairs:
        geometry.addCollisionPair(pin.CollisionPair(int(i), int(j)))
    state = geometry.createData()
    for k in range(len(collisions.pairs)):
        state.collisionRequests[k].security_margin = 0.003
    theirs = [
        pin.computeCollisions(model, data, geometry, state, q, True) for q in samples
    ]
    ours = collisions.codes(samples) == SELF
    assert 0.1 < np.mean(theirs) < 0.9
    # cylinders are prisms drawn around them here: contact at most 0.6 mm earlier
    assert not np.any(np.array(theirs) & ~ours)
    assert np.mean(ours == theirs) > 0.99


def test_more_padding_never_frees(robot, samples, collisions):
    wide = CollisionChecker(robot, padding=0.05)
    assert np.all(wide.codes(samples) >= collisions.codes(samples))
    assert np.any(wide.codes(samples) > collisions.codes(samples))


def test_only_pairs_that_the_group_moves_are_asked(robot, collisions):
    q = robot.home.copy()
    bad = {
        "arm_right_1_joint": -1.1,
        "arm_right_2_joint": -1.1,
        "arm_right_4_joint": 2.3,
    }
    for name, value in bad.items():
        q[robot.joint_names.index(name)] = value
    assert collisions.codes(q[None], RIGHT)[0] == collisions.codes(q[None])[0]
    head = collisions.codes(q[None], "head")[0]
    assert head == FREE


def test_an_arm_in_a_box_is_scene_collision(robot, collisions):
    tip = robot.frame_pose(robot.home, "gripper_left_tcp")[:3, 3]
    box = make_obstacles(boxes=[SolidBox(at(tip), np.full(3, 0.15))])
    assert collisions.codes(robot.home[None], LEFT, box)[0] == HAND
    assert collisions.first_contact(robot.home, LEFT, box).second == "scene"
    aside = make_obstacles(boxes=[SolidBox(at(tip + [0, 0.5, 0]), np.full(3, 0.05))])
    assert collisions.codes(robot.home[None], LEFT, aside)[0] == FREE


def test_a_point_between_open_jaws_is_free_and_in_a_finger_is_not(robot, collisions):
    T = robot.frame_pose(robot.home, "gripper_left_tcp")
    between = T @ [-0.01, 0.0, 0.0, 1.0]
    in_finger = T @ [-0.01, 0.0425 + 0.006, 0.0, 1.0]
    for point, code in ((between, FREE), (in_finger, HAND)):
        scene = make_obstacles(point[None, :3])
        assert collisions.codes(robot.home[None], LEFT, scene)[0] == code
    closed = robot.home.copy()
    robot.set_opening(closed, "left", 0.0)
    scene = make_obstacles((T @ [-0.01, 0.004, 0.0, 1.0])[None, :3])
    assert collisions.codes(closed[None], LEFT, scene)[0] == HAND


def test_what_the_hand_holds_is_not_in_its_way(robot, collisions):
    T = robot.frame_pose(robot.home, "gripper_left_tcp")
    scene = make_obstacles((T @ [-0.01, 0.0485, 0.0, 1.0])[None, :3])
    q = robot.home[robot.group_indices(LEFT)][None, None]
    ball = np.append(T[:3, 3], 0.12)[None]
    starts = robot.home[None]
    assert collisions.path_codes(q, starts, LEFT, obstacles=scene)[0] == HAND
    assert collisions.path_codes(q, starts, LEFT, obstacles=scene, held=ball)[0] == FREE


def test_points_and_a_box_of_the_same_shape_give_the_same_answer(
    robot, collisions, rng
):
    center, size = np.array([0.6, 0.3, 0.9]), np.array([0.3, 0.4, 0.2])
    # sample its faces
    points = rng.uniform(-0.5, 0.5, (60000, 3))
    face = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), face] = np.sign(points[np.arange(len(points)), face])
    points[np.arange(len(points)), face] *= 0.5
    cloud = make_obstacles(points * size + center, resolution=0.004)
    box = make_obstacles(boxes=[SolidBox(at(center), size)])
    indices = robot.group_indices(LEFT)
    chain = robot.chain(LEFT)
    q = np.tile(robot.home, (300, 1))
    q[:, indices] = rng.uniform(chain.lower, chain.upper, (300, 8))
    by_box = collisions.codes(q, LEFT, box)
    by_points = collisions.codes(q, LEFT, cloud)
    assert (by_box >= SCENE).sum() > 10
    assert np.mean((by_box >= SCENE) == (by_points >= SCENE)) > 0.97


def test_points_on_the_robot_are_told_from_others(robot, collisions):
    T = robot.frame_pose(robot.home, "arm_left_4_link")
    points = np.array([T[:3, 3], [2.0, 0.0, 0.5]])
    assert collisions.off_robot(points, robot.home).tolist() == [False, True]


def test_an_excluded_pair_may_touch(robot, samples, collisions):
    bad = samples[collisions.codes(samples) == SELF][0]
    pair = collisions.first_contact(bad)
    description = replace(robot.description, self_collision_exclusions=(tuple(pair),))
    again = CollisionChecker(RobotModel(description)).first_contact(bad)
    assert again != pair


def test_an_excluded_link_must_exist(robot):
    description = replace(
        robot.description, self_collision_exclusions=(("base_link", "tail"),)
    )
    with pytest.raises(RobotModelError, match="no frame 'tail'"):
        CollisionChecker(RobotModel(description))


def test_configurations_of_another_length_are_refused(collisions):
    with pytest.raises(ShapeError, match="configurations"):
        collisions.codes(np.zeros((2, 5)))
