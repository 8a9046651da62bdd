# SPDX-License-Identifier: Apache-2.0
import struct

import numpy as np
import pytest

from neugrasp_ros.errors import ObjectFileError
from neugrasp_ros.geometry.mesh import box_mesh
from sim_bridge.objects.mesh_files import read_mesh_groups
from sim_bridge.objects.mesh_repair import is_watertight

CUBE = box_mesh(np.array([0.5, 0.5, 0.5]))


def obj_text(mesh, first=1):
    vertices = "".join("v {} {} {}\n".format(*v) for v in mesh.vertices)
    faces = "".join("f {} {} {}\n".format(*(t + first)) for t in mesh.triangles)
    return vertices + faces


def stl_bytes(mesh):
    facets = b"".join(
        struct.pack("<12fH", 0, 0, 0, *mesh.vertices[t].ravel(), 0)
        for t in mesh.triangles
    )
    return b"x" * 80 + struct.pack("<I", len(mesh.triangles)) + facets


def test_obj_groups_become_meshes_of_their_own(tmp_path):
    path = tmp_path / "two.obj"
    moved = box_mesh(np.array([0.1, 0.1, 0.1]))
    path.write_text("o a\n" + obj_text(CUBE) + "o b\n" + obj_text(moved, first=9))
    meshes = read_mesh_groups(path)
    assert [round(mesh.volume(), 9) for mesh in meshes] == [1.0, 0.008]
    assert all(is_watertight(mesh) for mesh in meshes)


def test_obj_polygons_slashes_and_negative_indices_are_understood(tmp_path):
    path = tmp_path / "quad.obj"
    path.write_text(
        "# note\nvn 0 0 1\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf -4/1/1 -3//1 -2 -1\n"
    )
    (mesh,) = read_mesh_groups(path)
    np.testing.assert_array_equal(mesh.triangles, [[0, 1, 2], [0, 2, 3]])


def test_binary_stl_is_welded_into_a_closed_mesh(tmp_path):
    path = tmp_path / "cube.STL"
    path.write_bytes(stl_bytes(CUBE))
    (mesh,) = read_mesh_groups(path)
    assert len(mesh.vertices) == 8
    assert is_watertight(mesh)
    assert mesh.volume() == pytest.approx(1.0)


def test_ascii_stl_is_read(tmp_path):
    path = tmp_path / "cube.stl"
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join("vertex {} {} {}\n".format(*CUBE.vertices[i]) for i in triangle)
        + "endloop\nendfacet\n"
        for triangle in CUBE.triangles
    )
    path.write_text(f"solid cube\n{facets}endsolid cube\n")
    (mesh,) = read_mesh_groups(path)
    assert mesh.volume() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "has no faces"),
        ("a.obj", b"v 0 0 x\nf 1 1 1\n", "is not a valid OBJ"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "beyond the 1 there are"),
        ("a.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "not finite"),
        ("a.obj", b"\x00\xff\x13garbage", "has no faces"),
        ("a.stl", b"x" * 80 + struct.pack("<I", 7), "is not a valid STL"),
        ("a.stl", b"solid a\nvertex 0 0\n", "is not a valid ASCII STL"),
        ("a.stl", b"solid a\nendsolid a\n", "has no facets"),
        ("a.ply", b"ply", "expected one of .obj, .stl"),
    ],
)
def test_broken_files_say_what_is_wrong(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ObjectFileError, match=message) as caught:
        read_mesh_groups(path)
    assert caught.value.path == path


def test_missing_file_is_named(tmp_path):
    with pytest.raises(ObjectFileError, match="none.obj: cannot be read"):
        read_mesh_groups(tmp_path / "none.obj")
