# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from neugrasp_ros.errors import ConfigError, RobotModelError, ShapeError
from neugrasp_ros.geometry.transform import invert, make_transform
from neugrasp_ros.robot import seeds
from neugrasp_ros.robot.kinematics import ArmKinematics
from neugrasp_ros.robot.model import gripper_from_tcp
from neugrasp_ros.robot.settings import IkConfig

LEFT = "arm_left_torso"


def errors(reached, wanted):
    """Distances in [m] and angles in [rad] between poses."""
    between = invert(wanted) @ reached
    angles = Rotation.from_matrix(between[:, :3, :3]).magnitude()
    return np.linalg.norm(between[:, :3, 3], axis=1), angles


@pytest.fixture(scope="module")
def poses(left):
    q = np.random.default_rng(5).uniform(left.lower, left.upper, (400, 8))
    return left.forward(q)


def test_most_poses_of_the_arm_are_found_again(left, poses):
    assert left.solve(poses).reached.mean() >= 0.97


def test_every_answer_reaches_inside_the_limits(robot, left, poses):
    answer = left.solve(poses)
    q = answer.q[answer.reached]
    limits = robot.limits.take(left.indices)
    assert np.all(q >= limits.lower + 0.02 - 1e-12)
    assert np.all(q <= limits.upper - 0.02 + 1e-12)
    # by Pinocchio, not by the kernel that solved it
    wanted = poses[answer.reached]
    full = robot.home.copy()
    reached = []
    for values in q:
        full[left.indices] = values
        reached.append(gripper_from_tcp(robot.frame_pose(full, "gripper_left_tcp")))
    distances, angles = errors(np.array(reached), wanted)
    assert distances.max() < 1e-3
    assert angles.max() < 5e-3


def test_answers_are_polished_so_that_paths_come_out_smooth(left, poses):
    answer = left.solve(poses)
    q = answer.q[answer.reached]
    distances, _ = errors(left.forward(q), poses[answer.reached])
    assert np.median(distances) < 1e-5


def test_a_pose_out_of_reach_is_not_found(left, poses):
    far = poses.copy()
    far[:, 0, 3] += 5.0
    assert not left.solve(far).reached.any()
    assert not left.may_reach(far).any()
    assert not left.reaches_beyond_limits(far).any()


def test_the_reach_map_loses_nothing(left, poses):
    assert left.may_reach(poses).all()


def test_the_reach_map_rules_out_most_of_the_room(left, rng):
    poses = np.repeat(np.eye(4)[None], 500, axis=0)
    poses[:, :3, 3] = rng.uniform([-2, -2, 0], [2, 2, 2], (500, 3))
    assert left.may_reach(poses).mean() < 0.3


def test_just_beyond_the_limits_is_told_from_out_of_reach(robot, left, rng):
    q = rng.uniform(left.lower, left.upper, (50, 8))
    q[:, 6] = robot.limits.upper[left.indices[6]] + 0.3
    q[:, 4] = robot.limits.upper[left.indices[4]] + 0.3
    assert left.reaches_beyond_limits(left.forward(q)).mean() > 0.6


def test_the_present_posture_is_tried_first(left, rng):
    q = rng.uniform(left.lower, left.upper)
    target = left.forward(q)
    answer = left.solve(target, near=q)
    assert answer.seed[0] == 0
    assert answer.q[0] == pytest.approx(q, abs=1e-6)


def test_another_solution_can_be_asked_for(left, poses):
    first = left.solve(poses[:100])
    second = left.solve(poses[:100], after=first.seed)
    both = first.reached & second.reached
    assert both.mean() > 0.5
    assert np.all(second.seed[both] > first.seed[both])
    apart = np.abs(first.q[both] - second.q[both]).max(axis=1)
    assert np.median(apart) > 0.05  # eight joints, six numbers: another posture


def test_answers_can_be_drawn_towards_a_posture(robot, left, poses):
    ends = [left.lower, left.upper]
    answers = [left.solve(poses, towards=end, seeds=1) for end in ends]
    both = answers[0].reached & answers[1].reached
    assert both.mean() > 0.5
    speeds = robot.limits.velocity[left.indices]
    seconds = [
        [np.max(np.abs(a.q[both] - end) / speeds, axis=1).mean() for end in ends]
        for a in answers
    ]
    assert seconds[0][0] < seconds[1][0]
    assert seconds[1][1] < seconds[0][1]


def test_seeds_can_be_limited(left, poses):
    few = left.solve(poses, seeds=1)
    assert np.all(few.seed <= 1)
    assert few.reached.sum() <= left.solve(poses).reached.sum()


def test_a_straight_line_is_followed_without_jumps(left):
    above = make_transform(np.diag([1.0, -1, -1]), np.array([0.6, 0.2, 0.9]))[None]
    q = left.solve(above).q[0]
    start = left.forward(q)[0]
    line = np.repeat(start[None], 10, axis=0)
    line[:, :3, 3] += np.linspace(0, 0.1, 11)[1:, None] * start[:3, 2]
    path, reached = left.follow(line[None], q[None], max_change=0.35)
    assert reached[0] == 10
    distances, angles = errors(left.forward(path[0]), line)
    assert distances.max() < 1e-4
    assert angles.max() < 1e-3
    assert np.abs(np.diff(path[0], axis=0)).max() < 0.2


def test_a_line_out_of_the_workspace_breaks_off(left):
    q = (left.lower + left.upper) / 2
    start = left.forward(q)[0]
    line = np.repeat(start[None], 40, axis=0)
    line[:, 0, 3] += np.linspace(0, 2.0, 41)[1:]
    _, reached = left.follow(line[None], q[None], max_change=0.35)
    assert 0 < reached[0] < 40


def test_manipulability_is_a_share_and_falls_where_the_arm_is_stretched(left, rng):
    q = rng.uniform(left.lower, left.upper, (500, 8))
    values = left.manipulability(q)
    assert np.all((values >= 0) & (values <= 1))
    assert values.max() > 0.8
    stretched = (left.lower + left.upper) / 2
    stretched[3], stretched[4], stretched[6] = left.lower[3] * 0, 0.0, 0.0
    stretched[5] = 0.0
    assert left.manipulability(stretched)[0] < np.median(values)


def test_the_torso_moves_last(robot, poses, tmp_path, monkeypatch):
    monkeypatch.setattr(seeds, "SAMPLES", 20000)  # enough for this question
    lazy = ArmKinematics(robot, LEFT, IkConfig(slide_weight=0.01), tmp_path)
    eager = ArmKinematics(robot, LEFT, IkConfig(slide_weight=1.0), tmp_path)
    near = robot.home[lazy.indices]
    travel = []
    for arm in (lazy, eager):
        answer = arm.solve(poses, near=near, seeds=1)
        travel.append(np.abs(answer.q[answer.reached][:, 0] - near[0]).mean())
    assert travel[0] < travel[1]


def test_bad_questions_are_refused(robot, left):
    with pytest.raises(ShapeError, match="gripper poses"):
        left.solve(np.eye(4))
    with pytest.raises(RobotModelError, match="no group 'leg'"):
        ArmKinematics(robot, "leg")
    with pytest.raises(ConfigError, match="no tcp_frame"):
        ArmKinematics(robot, "head")
    with pytest.raises(ConfigError, match="tol_position"):
        IkConfig(tol_position=-1.0)
