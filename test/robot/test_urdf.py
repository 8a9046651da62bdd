# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from neugrasp_ros.errors import ConfigError, RobotModelError
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.robot.description import Placement, load_description
from neugrasp_ros.robot.urdf import derive_urdf, finger_joints


@pytest.fixture(scope="module")
def tiago():
    return ElementTree.fromstring(derive_urdf(load_description("tiago_dual")))


def names(robot, tag):
    return {element.get("name") for element in robot.findall(tag)}


def test_no_part_of_the_old_hands_is_left(tiago):
    assert not [name for name in names(tiago, "link") if name.startswith("hand_")]
    assert not [name for name in names(tiago, "joint") if name.startswith("hand_")]


def test_every_joint_connects_links_that_exist(tiago):
    links = names(tiago, "link")
    for joint in tiago.findall("joint"):
        assert joint.find("parent").get("link") in links
        assert joint.find("child").get("link") in links


def test_every_mesh_is_a_file(tiago):
    meshes = {mesh.get("filename") for mesh in tiago.iter("mesh")}
    assert len(meshes) > 10
    assert all(Path(mesh).is_file() for mesh in meshes)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_gripper_is_three_boxes_that_open_as_far_as_it_does(tiago, side):
    gripper = load_gripper("robotiq_2f85")
    for name in finger_joints(side):
        joint = tiago.find(f"joint[@name='{name}']")
        assert joint.get("type") == "prismatic"
        assert float(joint.find("limit").get("upper")) == gripper.max_opening / 2
        finger = tiago.find(f"link[@name='{joint.find('child').get('link')}']")
        size = finger.find("collision/geometry/box").get("size").split()
        assert [float(v) for v in size] == pytest.approx(
            [gripper.finger_depth, gripper.finger_width, gripper.finger_thickness]
        )


def test_closed_fingers_touch_at_the_axis_and_end_at_the_tcp(tiago):
    gripper = load_gripper("robotiq_2f85")
    origins = []
    for name in finger_joints("left"):
        link = name.replace("_slide_joint", "_finger_link")
        origin = tiago.find(f"link[@name='{link}']/collision/origin").get("xyz")
        origins.append([float(v) for v in origin.split()])
    assert origins[0][1] == pytest.approx(gripper.finger_width / 2)
    assert origins[1][1] == pytest.approx(-gripper.finger_width / 2)
    assert origins[0][0] + gripper.finger_depth / 2 == pytest.approx(
        gripper.mount_to_tcp
    )


def test_the_original_file_is_left_alone():
    path = load_description("tiago_dual").urdf
    before = path.read_bytes()
    derive_urdf(load_description("tiago_dual"))
    assert path.read_bytes() == before


def test_a_link_that_does_not_exist_is_named_with_those_that_do(toy_files):
    description = load_description(toy_files / "toy.yaml")
    wrong = replace(description, frames={"eye": Placement(parent="head")})
    with pytest.raises(RobotModelError, match="no link 'head'.*upper") as caught:
        derive_urdf(wrong)
    assert "lower" in caught.value.known


def test_a_link_to_remove_must_exist(toy_files):
    description = load_description(toy_files / "toy.yaml")
    with pytest.raises(RobotModelError, match="no link 'claw'"):
        derive_urdf(replace(description, remove_links=("claw",)))


def test_a_mesh_that_is_not_there_is_named(toy_files, tmp_path):
    text = (toy_files / "toy.urdf").read_text()
    for name in ("package://nowhere/a.stl", "a.stl"):
        path = tmp_path / "toy.urdf"
        path.write_text(text.replace('<box size="0.2 0.2 0.1"/>', mesh(name)))
        description = load_description(toy_files / "toy.yaml", urdf=path)
        with pytest.raises(ConfigError, match="no mesh"):
            derive_urdf(description)


def test_a_mesh_is_found_in_the_package_path(toy_files, tmp_path, monkeypatch):
    (tmp_path / "share" / "parts").mkdir(parents=True)
    (tmp_path / "share" / "parts" / "a.stl").touch()
    text = (toy_files / "toy.urdf").read_text()
    path = tmp_path / "toy.urdf"
    path.write_text(
        text.replace('<box size="0.2 0.2 0.1"/>', mesh("package://parts/a.stl"))
    )
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    urdf = derive_urdf(load_description(toy_files / "toy.yaml", urdf=path))
    assert str(tmp_path / "share" / "parts" / "a.stl") in urdf


def mesh(name):
    return f'<mesh filename="{name}"/>'
