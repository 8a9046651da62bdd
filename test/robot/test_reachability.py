# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from neugrasp_ros.errors import ConfigError, RobotModelError, ShapeError
from neugrasp_ros.geometry.transform import flip_gripper, invert, make_transform
from neugrasp_ros.robot.contact import FREE
from neugrasp_ros.robot.obstacles import SolidBox, make_obstacles
from neugrasp_ros.robot.reachability import Reach, ReachabilityChecker
from neugrasp_ros.robot.settings import IkConfig, ReachabilityConfig

LEFT, RIGHT = "arm_left_torso", "arm_right_torso"
DOWN = np.diag([1.0, -1.0, -1.0])  # approach downwards, closing along y


def table(top=0.72):
    return SolidBox(
        make_transform(np.eye(3), np.array([0.85, 0.0, top - 0.02])),
        np.array([0.8, 1.2, 0.04]),
    )


def grasps_above_a_table(count, seed=0, top=0.72):
    """Grasps from above and ahead, some out of reach."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        tilt = Rotation.from_euler(
            "zyz", [rng.uniform(-1, 1), -rng.uniform(0, 1.2), rng.uniform(-3, 3)]
        )
        position = rng.uniform([0.5, -0.4, top + 0.02], [1.0, 0.4, top + 0.2])
        poses.append(make_transform(tilt.as_matrix() @ DOWN, position))
    return np.array(poses)


@pytest.fixture(scope="module")
def scene():
    return make_obstacles(boxes=[table()])


@pytest.fixture(scope="module")
def grasps():
    return grasps_above_a_table(60)


@pytest.fixture(scope="module")
def result(reach, grasps, scene):
    return reach.check(grasps, obstacles=scene)


def poses_of(reach, result, row, q):
    return reach.arms[result.arm_of(row)].forward(q)


def test_some_grasps_are_reached_and_some_are_not(result):
    assert 10 < result.reachable.sum() < len(result)


def test_reached_grasps_are_at_the_asked_pose_or_its_twin(reach, result, grasps):
    for row in np.flatnonzero(result.reachable):
        arm = reach.arms[result.arm_of(row)]
        wanted = grasps[row]
        if result.flipped[row]:
            wanted = flip_gripper(wanted)
        between = invert(wanted) @ arm.forward(result.q[row][arm.indices])[0]
        assert np.linalg.norm(between[:3, 3]) < 1e-3
        assert Rotation.from_matrix(between[:3, :3]).magnitude() < 5e-3


def test_approach_ends_at_the_grasp_after_a_straight_way_along_z(reach, result, grasps):
    for row in np.flatnonzero(result.reachable):
        poses = poses_of(reach, result, row, result.approach[row])
        arm = reach.arms[result.arm_of(row)]
        assert np.array_equal(result.approach[row][-1], result.q[row][arm.indices])
        along = grasps[row][:3, 2]
        way = poses[:, :3, 3] - grasps[row][:3, 3]
        assert way[0] @ along == pytest.approx(-0.10, abs=1e-3)
        aside = way - np.outer(way @ along, along)
        assert np.linalg.norm(aside, axis=1).max() < 1e-3
        assert np.all(np.diff(way @ along) > 0)


def test_the_lift_goes_straight_up_from_the_grasp(reach, result, grasps):
    for row in np.flatnonzero(result.reachable):
        poses = poses_of(reach, result, row, result.lift[row])
        way = poses[:, :3, 3] - grasps[row][:3, 3]
        assert way[-1] == pytest.approx([0, 0, 0.10], abs=1e-3)
        assert np.abs(way[:, :2]).max() < 1e-3


def test_every_posture_on_the_way_is_inside_limits_and_free(
    robot, reach, result, scene
):
    for row in np.flatnonzero(result.reachable):
        name = result.arm_of(row)
        arm = reach.arms[name]
        way = np.concatenate([result.approach[row], result.lift[row]])
        assert np.all((way >= arm.lower - 1e-12) & (way <= arm.upper + 1e-12))
        full = np.tile(robot.home, (len(way), 1))
        full[:, arm.indices] = way
        assert np.all(reach.collisions.codes(full, name, scene) == FREE)


def test_nothing_is_told_of_grasps_that_are_not_reached(result):
    lost = ~result.reachable
    assert np.all(result.arms[lost] == -1)
    assert np.isnan(result.q[lost]).all()
    assert np.isnan(result.manipulability[lost]).all()
    assert result.arm_of(int(np.flatnonzero(lost)[0])) == ""


def test_manipulability_is_a_share(result):
    values = result.manipulability[result.reachable]
    assert np.all((values > 0) & (values <= 1))


def test_both_arms_are_used_each_on_its_side(result, grasps):
    y = grasps[:, 1, 3]
    used = [result.arm_names[number] for number in result.arms[result.reachable]]
    assert set(used) == {LEFT, RIGHT}
    left = result.arms == result.arm_names.index(LEFT)
    right = result.arms == result.arm_names.index(RIGHT)
    assert y[left].mean() > y[right].mean()


def test_the_input_is_left_alone(reach, scene):
    poses = grasps_above_a_table(5)
    before = poses.copy()
    reach.check(poses, obstacles=scene)
    assert np.array_equal(poses, before)


def test_far_away_is_no_ik(reach):
    far = make_transform(DOWN, np.array([4.0, 0.0, 0.8]))[None]
    assert reach.check(far).codes.tolist() == [Reach.NO_IK]


def test_only_beyond_the_limits_is_said_so(robot, reach):
    arm = reach.arms[LEFT]
    rng = np.random.default_rng(11)
    q = rng.uniform(arm.lower, arm.upper, (40, 8))
    q[:, 0] = robot.limits.upper[arm.indices[0]] + 0.15  # a longer torso
    q[:, 2] = robot.limits.lower[arm.indices[2]] - 0.4
    codes = reach.check(arm.forward(q), arms=[LEFT]).codes
    assert (codes == Reach.LIMITS).sum() >= 5


def test_a_hand_in_the_table_is_scene_collision(reach, scene):
    inside = grasps_above_a_table(20, seed=2)
    inside[:, :3, :3] = DOWN
    inside[:, :3, 3] = np.linspace([0.6, -0.2, 0.71], [0.7, 0.2, 0.71], 20)
    result = reach.check(inside, obstacles=scene)
    free = reach.check(inside).reachable
    assert free.sum() >= 5
    assert set(result.codes[free]) == {Reach.SCENE_COLLISION}
    assert not result.reachable.any()


def test_a_hand_in_its_own_body_is_self_collision(reach):
    # in the middle of the torso, from the front
    forward = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    heights = np.linspace(0.75, 0.95, 8)
    poses = make_transform(
        forward, np.stack([np.full(8, 0.05), np.zeros(8), heights], axis=1)
    )
    codes = reach.check(poses).codes
    assert not np.any(codes == Reach.OK)
    assert np.any(codes == Reach.SELF_COLLISION)


def test_a_lid_over_the_approach_is_no_approach(reach):
    grasp = make_transform(DOWN, np.array([0.6, 0.2, 0.80]))[None]
    assert reach.check(grasp).reachable.all()
    arm = reach.check(grasp)
    q = arm.approach[0, 0]
    # at the palm's corner before the approach; behind it, the wrist is slimmer
    name = arm.arm_of(0)
    palm = reach.arms[name].forward(q)[0] @ [0.034, 0.052, -0.06, 1.0]
    lid = make_obstacles(palm[None, :3])
    blocked = reach.check(grasp, obstacles=lid)
    assert blocked.codes.tolist() == [Reach.NO_APPROACH]


def test_wide_jaws_hit_what_narrow_ones_pass(reach):
    grasp = make_transform(DOWN, np.array([0.6, 0.2, 0.80]))[None]
    side = grasp[0, :3, 3] + [0.0, 0.048, 0.01]
    scene = make_obstacles(np.stack([side, side * [1, -1, 1] + [0, 0.4, 0]]))
    wide = reach.check(grasp, obstacles=scene)
    narrow = reach.check(grasp, obstacles=scene, openings=np.array([0.04]))
    assert wide.codes.tolist() == [Reach.SCENE_COLLISION]
    assert narrow.codes.tolist() == [Reach.OK]


def test_jaws_that_are_closed_now_approach_open(robot, reach):
    grasp = make_transform(DOWN, np.array([0.6, 0.2, 0.80]))[None]
    closed = robot.home.copy()
    for key in robot.grippers:
        robot.set_opening(closed, key, 0.0)
    between = make_obstacles(grasp[:, :3, 3])  # what the grasp is for
    result = reach.check(grasp, start=closed, obstacles=between)
    assert result.codes.tolist() == [Reach.OK]
    arm = robot.description.groups[result.arm_of(0)]
    opened = result.q[0].copy()
    robot.set_opening(opened, arm.gripper, robot.grippers[arm.gripper].max_opening)
    np.testing.assert_array_equal(result.q[0], opened)
    kept = reach.check(grasp, start=closed, obstacles=between, openings=np.array([0.0]))
    assert kept.codes.tolist() == [Reach.SCENE_COLLISION]


def test_the_scene_is_passed_over_when_told_to(robot, scene):
    inside = make_transform(DOWN, np.array([0.6, 0.2, 0.70]))[None]
    config = ReachabilityConfig(check_scene_collision=False)
    result = ReachabilityChecker(robot, config).check(inside, obstacles=scene)
    assert result.reachable.all()


def test_a_twin_is_as_good_as_the_grasp(reach, grasps, scene, result):
    twins = reach.check(flip_gripper(grasps), obstacles=scene)
    assert np.mean(twins.reachable == result.reachable) > 0.95


UNSOLVED = (Reach.NO_IK, Reach.LIMITS)
FEW_STEPS = 2  # from a start, so that many starts fail


def solved_with(robot, poses, first, most):
    config = ReachabilityConfig(first_starts=first, most_starts=most, retries=0)
    few = IkConfig(restarts=128, max_iterations=FEW_STEPS)
    checker = ReachabilityChecker(robot, config, few)
    sides = np.concatenate([poses, flip_gripper(poses)])
    arm = checker.arms[LEFT]
    near = robot.home[arm.indices]
    reached = arm.solve(sides, towards=near, seeds=most).reached
    codes = checker.check(poses, arms=[LEFT]).codes
    return ~np.isin(codes, UNSOLVED), reached.reshape(2, -1).any(axis=0)


def test_a_grasp_is_given_up_after_as_many_starts_as_asked(robot, left):
    rng = np.random.default_rng(0)
    some = rng.uniform(left.lower, left.upper, (1000, len(left.lower)))
    poses = left.forward(some)  # there is a solution to each of them
    counts = []
    for first, most in ((1, 1), (1, 3), (128, 128)):
        solved, wanted = solved_with(robot, poses, first, most)
        assert np.array_equal(solved, wanted)
        counts.append(solved.sum())
    assert counts[0] < counts[1] < counts[2]


def test_no_grasps_are_no_answers(reach):
    assert len(reach.check(np.zeros((0, 4, 4)))) == 0


def test_bad_questions_are_refused(reach):
    with pytest.raises(ShapeError, match="gripper poses"):
        reach.check(np.eye(4))
    with pytest.raises(RobotModelError, match="no arm 'leg'.*arm_left_torso"):
        reach.check(np.eye(4)[None], arms=["leg"])
    with pytest.raises(ConfigError, match="lift_distance"):
        ReachabilityConfig(lift_distance=9.0)
