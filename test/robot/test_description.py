# SPDX-License-Identifier: Apache-2.0
import pytest
import yaml

from neugrasp_ros.errors import ConfigError, UnknownNameError
from neugrasp_ros.robot.description import load_description


def write(folder, values):
    path = folder / "other.yaml"
    path.write_text(yaml.safe_dump(values))
    return path


@pytest.fixture
def values(toy_files):
    loaded = yaml.safe_load((toy_files / "toy.yaml").read_text())
    loaded["urdf"] = {"path": str(toy_files / "toy.urdf")}
    return loaded


def test_tiago_is_read_where_pip_put_it():
    description = load_description("tiago_dual")
    assert description.arms == ("arm_left_torso", "arm_right_torso")
    assert description.urdf.name == "tiago_dual.urdf"
    assert "example-robot-data" in description.urdf.parts
    assert description.grippers["left"].placement.parent == "wrist_left_ft_tool_link"


def test_a_file_of_ones_own_is_read_beside_its_urdf(toy_files):
    description = load_description(toy_files / "toy.yaml")
    assert description.urdf == toy_files / "toy.urdf"
    assert description.groups["arm"].joints == ("slide", "swing", "spin")
    assert description.motion_limits["slide"].jerk == 5.0


def test_another_urdf_can_be_put_in_its_place(toy_files, tmp_path):
    other = tmp_path / "other.urdf"
    other.write_text((toy_files / "toy.urdf").read_text())
    assert load_description(toy_files / "toy.yaml", urdf=other).urdf == other


def test_an_unknown_robot_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match="tiago_dual"):
        load_description("pr2")


def test_an_unknown_key_is_refused(values, tmp_path):
    with pytest.raises(ConfigError, match=r"unknown \['colour'\]"):
        load_description(write(tmp_path, values | {"colour": "red"}))


def test_a_missing_key_is_refused(values, tmp_path):
    del values["base_frame"]
    with pytest.raises(ConfigError, match="base_frame"):
        load_description(write(tmp_path, values))


def test_a_group_with_an_unknown_gripper_is_refused(values, tmp_path):
    values["groups"]["arm"]["gripper"] = "left"
    with pytest.raises(ConfigError, match="gripper 'left'"):
        load_description(write(tmp_path, values))


def test_a_urdf_that_is_not_there_is_refused(values, tmp_path):
    with pytest.raises(ConfigError, match="no robot description"):
        load_description(write(tmp_path, values | {"urdf": {"path": "gone.urdf"}}))


def test_a_distribution_that_is_not_installed_is_refused(values, tmp_path):
    urdf = {"distribution": "no-such-robots", "file": "a.urdf"}
    with pytest.raises(ConfigError, match="no-such-robots is not installed"):
        load_description(write(tmp_path, values | {"urdf": urdf}))


def test_a_file_that_is_not_in_the_distribution_is_refused(values, tmp_path):
    urdf = {"distribution": "example-robot-data", "file": "gone.urdf"}
    with pytest.raises(ConfigError, match=r"holds no gone\.urdf"):
        load_description(write(tmp_path, values | {"urdf": urdf}))


def test_an_unknown_key_of_a_frame_is_refused(values, tmp_path):
    values["frames"]["tip"]["quat"] = [0, 0, 0, 1]
    with pytest.raises(ConfigError, match="quat"):
        load_description(write(tmp_path, values))
