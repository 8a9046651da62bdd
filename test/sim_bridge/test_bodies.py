# SPDX-License-Identifier: Apache-2.0
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sim_shapes import model_of

from neugrasp_ros.geometry.transform import (
    make_transform,
    random_rotation,
    to_position_quaternion,
    translation,
)
from sim_bridge.bodies import (
    origin_tag,
    pose_tuple,
    transform_from,
    write_object_urdf,
)
from sim_bridge.objects.model import Part


def test_pose_tuple_agrees_with_scipy_up_to_the_sign_of_the_quaternion():
    rng = np.random.default_rng(0)
    for _ in range(200):
        pose = make_transform(random_rotation(rng), rng.normal(size=3))
        position, quaternion = pose_tuple(pose)
        expected = to_position_quaternion(pose)
        np.testing.assert_allclose(position, expected[0])
        assert abs(np.dot(quaternion, expected[1])) > 1 - 1e-12


def test_half_turns_survive_the_round_trip():
    for diagonal in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]):
        pose = np.diag([*diagonal, 1.0])
        np.testing.assert_allclose(transform_from(*pose_tuple(pose)), pose, atol=1e-12)


def test_pose_tuple_gives_the_position_of_an_offset_point():
    pose = translation(1.0, 2.0, 3.0) @ np.diag([1.0, -1.0, -1.0, 1.0])
    position, _ = pose_tuple(pose, np.array([0.0, 0.0, 0.5]))
    np.testing.assert_allclose(position, [1.0, 2.0, 2.5])


def test_a_urdf_has_one_element_per_primitive_and_one_mesh_for_all_hulls(tmp_path):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    model = model_of(
        Part("box", (0.01, 0.02, 0.03)),
        Part("hull", vertices=0.01 * corners),
        Part("hull", vertices=0.02 * corners, pose=translation(0.1, 0.0, 0.0)),
    )
    root = ET.parse(write_object_urdf(model, tmp_path, "thing")).getroot()
    geometries = [e[0] for e in root.iter("geometry")]
    assert [g.tag for g in geometries] == ["box", "mesh"]
    assert geometries[0].get("size") == "0.02 0.04 0.06"
    lines = (tmp_path / "thing.obj").read_text().splitlines()
    assert sum(line.startswith("o ") for line in lines) == 2
    vertices = np.array([line.split()[1:] for line in lines if line[0] == "v"], float)
    assert vertices[:, 0].max() == 0.12
    used = {int(i) for line in lines if line[0] == "f" for i in line.split()[1:]}
    assert used == set(range(1, 17))


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2])
def test_origins_hold_for_any_rotation_gimbal_lock_included(pitch):
    matrix = Rotation.from_euler("xyz", [0.4, pitch, -1.1]).as_matrix()
    tag = ET.fromstring(origin_tag(make_transform(matrix, np.zeros(3))))
    angles = [float(value) for value in tag.get("rpy").split()]
    np.testing.assert_allclose(
        Rotation.from_euler("xyz", angles).as_matrix(), matrix, atol=1e-7
    )
