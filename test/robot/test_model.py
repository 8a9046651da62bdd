# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import yaml

from neugrasp_ros.errors import ConfigError, RobotModelError, ShapeError
from neugrasp_ros.geometry.transform import invert
from neugrasp_ros.robot.model import gripper_from_tcp, load_robot, tcp_from_gripper

LEFT = "arm_left_torso"


def test_tiago_has_torso_arms_head_and_fingers(robot):
    assert len(robot.joint_names) == 1 + 14 + 2 + 4
    index = robot.joint_names.index("torso_lift_joint")
    assert robot.limits.lower[index] == 0.0
    assert robot.limits.upper[index] == pytest.approx(0.35)
    assert robot.limits.velocity[index] == pytest.approx(0.07)
    assert robot.limits.acceleration[index] == 0.3
    assert robot.limits.jerk[robot.joint_names.index("arm_left_1_joint")] == 30.0


def test_the_head_camera_is_where_the_robot_sheet_says(robot):
    T = robot.frame_pose(robot.configuration({}), "head_front_camera_rgb_optical_frame")
    assert T[:3, 3] == pytest.approx([0.216, 0.022, 1.067], abs=1e-3)
    assert T[:3, 2] == pytest.approx([1, 0, 0], abs=1e-6)  # looks ahead
    assert T[:3, 1] == pytest.approx([0, 0, -1], abs=1e-6)  # y down


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_tcp_lies_16_centimetres_ahead_of_the_mounting_face(robot, side):
    q = robot.home
    mount = robot.frame_pose(q, f"wrist_{side}_ft_tool_link")
    T = invert(mount) @ robot.frame_pose(q, f"gripper_{side}_tcp")
    assert T[:3, 3] == pytest.approx([0.1603, 0, 0])
    assert T[:3, :3] == pytest.approx(np.eye(3))
    pal = invert(mount) @ robot.frame_pose(q, f"gripper_{side}_grasping_frame")
    assert pal[:3, 3] == pytest.approx([0.13754, 0, 0])
    assert pal[:3, :3] == pytest.approx(np.eye(3))


@pytest.mark.parametrize("side", ["left", "right"])
def test_added_camera_frames_are_the_old_ones(robot, side):
    del side
    for kind in ("rgb", "depth"):
        ours = robot.frame_pose(robot.home, f"head_front_camera_{kind}_optical_frame")
        assert np.allclose(
            ours, robot.frame_pose(robot.home, f"xtion_{kind}_optical_frame")
        )


def test_gripper_axes_are_those_of_the_frame_sheet(rng):
    T = np.eye(4)
    T[:3, 3] = 1.0, 2.0, 3.0
    ours = gripper_from_tcp(T)
    assert np.allclose(ours[:3, 2], T[:3, 0])  # approach
    assert np.allclose(ours[:3, 1], T[:3, 1])  # closing
    assert np.allclose(ours[:3, 0], -T[:3, 2])
    assert np.allclose(ours[:3, 3], T[:3, 3])
    batch = rng.normal(size=(5, 4, 4))
    assert np.allclose(tcp_from_gripper(gripper_from_tcp(batch)), batch)


def test_a_configuration_comes_from_joint_states(robot):
    q = robot.configuration({"arm_left_1_joint": 0.5, "wheel_left_joint": 3.0})
    assert q[robot.joint_names.index("arm_left_1_joint")] == 0.5
    kept = robot.configuration({"head_1_joint": 0.1}, default=robot.home)
    same = np.array([name != "head_1_joint" for name in robot.joint_names])
    assert np.array_equal(kept[same], robot.home[same])
    assert kept is not robot.home


def test_jaws_are_open_until_told_otherwise(robot):
    q = robot.configuration({})
    fingers = [n for n in robot.joint_names if n.startswith("gripper_left")]
    index = [robot.joint_names.index(name) for name in fingers]
    assert q[index] == pytest.approx([0.0425, 0.0425])
    robot.set_opening(q, "left", 0.03)
    assert q[index] == pytest.approx([0.015, 0.015])


def test_all_values_at_home_are_inside_the_limits(robot):
    assert np.all(robot.home >= robot.limits.lower)
    assert np.all(robot.home <= robot.limits.upper)


def test_toy_forward_kinematics_in_closed_form(toy_files):
    toy = load_robot(toy_files / "toy.yaml")
    assert toy.joint_names == ("slide", "swing", "spin")
    q = toy.configuration({"slide": 0.2, "swing": 0.3, "spin": 4.0})
    T = toy.frame_pose(q, "tip")
    # base frame: slide along y, then a swing about x at 0.3 m of a 1 m rod
    assert T[:3, 3] == pytest.approx([0, 0.2 - np.sin(0.3), 0.3 + np.cos(0.3)])
    assert T[:3, 0] == pytest.approx(
        [np.cos(4.0), np.sin(4.0) * np.cos(0.3), np.sin(4.0) * np.sin(0.3)]
    )
    assert toy.home == pytest.approx([0.0, 0.25, 0.0])


def test_a_missing_frame_is_refused_naming_those_there_are(robot):
    with pytest.raises(RobotModelError, match="no frame 'camera'") as caught:
        robot.frame_pose(robot.home, "camera")
    assert "gripper_left_tcp" in caught.value.known


@pytest.mark.parametrize(
    ("key", "value", "match"),
    [
        ("base_frame", "floor", "no frame 'floor'.*base"),
        ("groups", {"arm": {"joints": ["slide", "bend"]}}, "no joint 'bend'.*swing"),
        (
            "groups",
            {"arm": {"joints": ["slide", "swing", "spin"], "tcp_frame": "nail"}},
            "no frame 'nail'.*lower",
        ),
        ("home", {"bend": 0.1}, "no joint 'bend'"),
        ("motion_limits", {"bend": {"acceleration": 1, "jerk": 1}}, "no joint 'bend'"),
    ],
)
def test_a_description_that_does_not_fit_is_refused(
    toy_files, tmp_path, key, value, match
):
    values = yaml.safe_load((toy_files / "toy.yaml").read_text())
    values["urdf"] = {"path": str(toy_files / "toy.urdf")}
    values[key] = value
    path = tmp_path / "toy.yaml"
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(RobotModelError, match=match):
        load_robot(path)


def test_a_base_frame_that_moves_is_refused(toy_files, tmp_path):
    values = yaml.safe_load((toy_files / "toy.yaml").read_text())
    values |= {"urdf": {"path": str(toy_files / "toy.urdf")}, "base_frame": "upper"}
    path = tmp_path / "toy.yaml"
    path.write_text(yaml.safe_dump(values))
    with pytest.raises(ConfigError, match="upper moves"):
        load_robot(path)


def test_an_unknown_group_is_refused(robot):
    with pytest.raises(RobotModelError, match="no group 'leg'"):
        robot.group_indices("leg")


def test_a_group_without_a_hand_is_no_chain(robot):
    with pytest.raises(ConfigError, match="head has no tcp_frame"):
        robot.chain("head")


def test_a_configuration_of_another_length_is_refused(robot):
    with pytest.raises(ShapeError, match="configuration"):
        robot.frame_pose(np.zeros(3), "base_link")
