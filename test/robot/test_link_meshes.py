# SPDX-License-Identifier: Apache-2.0
"""Meshes of a toy robot, whose volumes and places are known."""

import struct

import numpy as np
import pytest

from neugrasp_ros.robot.link_meshes import LinkMeshes, VisualMeshes
from neugrasp_ros.robot.model import load_robot

TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
FACES = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))  # seen from outside
BOX = """<visual><origin xyz="0 0 0.4"/><geometry><box size="0.1 0.1 0.2"/></geometry>
  <material name="red"><color rgba="0.8 0.1 0.2 1"/></material></visual>"""
STL = """<visual><geometry><mesh filename="file://{path}" scale="0.1 0.1 0.1"/>
  </geometry></visual>"""


def volume(mesh) -> float:
    """Signed: positive where the faces look outwards."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.fixture(scope="module")
def toy(toy_files):
    return load_robot(toy_files / "toy.yaml")


def test_hulls_become_meshes_that_look_outwards(toy):
    links = LinkMeshes(toy)
    assert sorted(volume(m) for m in links.meshes) == pytest.approx([0.002, 0.004])


def test_meshes_go_where_their_bodies_go(toy):
    links = LinkMeshes(toy)
    lower = int(np.argmin([volume(m) for m in links.meshes]))
    q = toy.configuration({"slide": 0.2, "swing": 0.3, "spin": 0.0})
    T = links.poses(q)[lower]
    middle = T[:3, :3] @ links.meshes[lower].vertices.mean(axis=0) + T[:3, 3]
    s, c = np.sin(0.3), np.cos(0.3)
    assert middle == pytest.approx([0.0, 0.2 - 0.9 * s, 0.3 + 0.9 * c])
    base = links.poses(q)[1 - lower]
    assert base == pytest.approx(np.eye(4))


def test_the_body_of_a_joint_is_left_out(toy):
    (base,) = LinkMeshes(toy, without=("spin",)).meshes
    assert volume(base) == pytest.approx(0.004)


@pytest.fixture(scope="module")
def drawn(toy_files, tmp_path_factory):
    """The toy with a red box to see at its tip, and a tetrahedron at its base."""
    folder = tmp_path_factory.mktemp("drawn")
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *TETRAHEDRON[list(face)].ravel(), 0)
        for face in FACES
    )
    path = folder / "tetrahedron.stl"
    path.write_bytes(bytes(80) + struct.pack("<I", len(FACES)) + facets)
    urdf = (toy_files / "toy.urdf").read_text()
    urdf = urdf.replace('<link name="lower">', f'<link name="lower">{BOX}')
    urdf = urdf.replace(
        '<link name="base">', f'<link name="base">{STL.format(path=path)}'
    )
    (folder / "toy.urdf").write_text(urdf)
    (folder / "toy.yaml").write_text((toy_files / "toy.yaml").read_text())
    return load_robot(folder / "toy.yaml")


def test_what_is_seen_has_its_shape_and_colour(drawn):
    look = VisualMeshes(drawn)
    volumes = np.array([volume(m) for m in look.meshes])
    box, tetrahedron = int(np.argmax(volumes)), int(np.argmin(volumes))
    assert volumes[box] == pytest.approx(0.002)
    assert volumes[tetrahedron] == pytest.approx(0.1**3 / 6)
    assert look.colors.shape == (2, 3)
    assert look.colors[box] == pytest.approx([0.8, 0.1, 0.2], abs=1e-6)


def test_what_is_seen_goes_with_the_arm(drawn):
    look = VisualMeshes(drawn)
    box = int(np.argmax([volume(m) for m in look.meshes]))
    q = drawn.configuration({"slide": -0.1, "swing": 0.3, "spin": 1.0})
    s, c = np.sin(0.3), np.cos(0.3)
    place = look.poses(q)[box][:3, 3]
    assert place == pytest.approx([0.0, -0.1 - 0.9 * s, 0.3 + 0.9 * c])
