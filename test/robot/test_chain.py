# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.robot.chain import (
    chain_jacobians,
    chain_poses,
    make_chain,
    turn_z_to,
)
from neugrasp_ros.robot.model import load_robot


@pytest.mark.parametrize("group", ["arm_left_torso", "arm_right_torso"])
def test_forward_kinematics_equals_pinocchio(robot, rng, group):
    chain, indices = robot.chain(group), robot.group_indices(group)
    tcp = robot.description.groups[group].tcp_frame
    q = rng.uniform(chain.lower, chain.upper, (30, len(indices)))
    poses = chain_poses(chain, q)
    for values, pose in zip(q, poses, strict=True):
        full = robot.home.copy()
        full[indices] = values
        assert np.abs(robot.frame_pose(full, tcp) - pose).max() < 1e-9


def test_a_chain_about_other_axes_equals_pinocchio(toy_files, rng):
    toy = load_robot(toy_files / "toy.yaml")
    chain = toy.chain("arm")
    for q in rng.uniform([-0.5, -2, -3], [0.5, 2, 3], (10, 3)):
        pose = chain_poses(chain, q[None])[0]
        assert np.abs(toy.frame_pose(q, "tip") - pose).max() < 1e-9


def test_the_jacobian_is_the_slope_of_the_pose(robot, rng):
    chain = robot.chain("arm_left_torso")
    q = rng.uniform(chain.lower, chain.upper)
    jacobian = chain_jacobians(chain, q[None])[0]
    step = 1e-6
    for k in range(len(q)):
        shift = np.eye(len(q))[k] * step
        ahead, behind = chain_poses(chain, np.stack([q + shift, q - shift]))
        linear = (ahead[:3, 3] - behind[:3, 3]) / (2 * step)
        turn = (ahead[:3, :3] - behind[:3, :3]) / (2 * step) @ behind[:3, :3].T
        angular = np.array([turn[2, 1], turn[0, 2], turn[1, 0]])
        assert jacobian[:3, k] == pytest.approx(linear, abs=1e-5)
        assert jacobian[3:, k] == pytest.approx(angular, abs=1e-5)


@pytest.mark.parametrize("axis", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0.6, -0.8, 0]])
def test_z_is_turned_to_the_axis(axis):
    turn = turn_z_to(np.array(axis, dtype=float))
    assert turn[:, 2] == pytest.approx(axis)
    assert turn @ turn.T == pytest.approx(np.eye(3))
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_lengths_that_do_not_fit_are_refused():
    two = np.repeat(np.eye(4)[None], 2, axis=0)
    bounds = {"lower": np.zeros(2), "upper": np.ones(2)}
    slides = np.zeros(2, dtype=bool)
    with pytest.raises(ShapeError, match="placements"):
        make_chain(two, np.eye(3)[:2], slides, **bounds)
    three = np.repeat(np.eye(4)[None], 3, axis=0)
    with pytest.raises(ShapeError, match="axes"):
        make_chain(three, np.eye(3), slides, **bounds)
