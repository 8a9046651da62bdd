# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.kinematics import ArmKinematics
from neugrasp_ros.robot.model import load_robot
from neugrasp_ros.robot.reachability import ReachabilityChecker

LEFT, RIGHT = "arm_left_torso", "arm_right_torso"


@pytest.fixture(scope="session")
def robot():
    return load_robot("tiago_dual")


@pytest.fixture(scope="session")
def reach(robot):
    return ReachabilityChecker(robot)


@pytest.fixture(scope="session")
def left(reach) -> ArmKinematics:
    return reach.arms[LEFT]


@pytest.fixture(scope="session")
def collisions(reach) -> CollisionChecker:
    return reach.collisions


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def toy_files(tmp_path_factory):
    """A slide and two turning joints, one about x, with a box at the tip."""
    folder = tmp_path_factory.mktemp("toy")
    (folder / "toy.urdf").write_text(TOY_URDF)
    (folder / "toy.yaml").write_text(TOY_YAML)
    return folder


TOY_URDF = """<robot name="toy">
  <link name="world"/>
  <link name="base"><collision><geometry><box size="0.2 0.2 0.1"/></geometry>
    </collision></link>
  <link name="cart"/>
  <link name="upper"/>
  <link name="lower"><collision><origin xyz="0 0 0.4"/><geometry>
    <box size="0.1 0.1 0.2"/></geometry></collision></link>
  <link name="old_hand"/>
  <link name="old_finger"/>
  <joint name="mount" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="1 2 0" rpy="0 0 1.5707963267948966"/></joint>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="cart"/>
    <axis xyz="0 1 0"/>
    <limit lower="-0.5" upper="0.5" velocity="0.1" effort="1"/></joint>
  <joint name="swing" type="revolute"><parent link="cart"/><child link="upper"/>
    <origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/></joint>
  <joint name="spin" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
    <limit velocity="1" effort="1"/></joint>
  <joint name="wrist" type="fixed"><parent link="lower"/><child link="old_hand"/>
    <origin xyz="0 0 0.5"/></joint>
  <joint name="grip" type="revolute"><parent link="old_hand"/>
    <child link="old_finger"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="1" velocity="1" effort="1"/></joint>
</robot>
"""

TOY_YAML = """name: toy
urdf: {path: toy.urdf}
base_frame: base
remove_links: [old_hand]
frames:
  tip: {parent: lower, xyz: [0.0, 0.0, 0.5]}
groups:
  arm: {joints: [slide, swing, spin], tcp_frame: tip}
home: {swing: 0.25}
motion_limits:
  default: {acceleration: 2.0, jerk: 20.0}
  slide: {acceleration: 0.5, jerk: 5.0}
"""
