# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.mesh import Mesh, box_mesh
from sim_bridge.objects.mesh_repair import (
    close_meshes,
    is_watertight,
    merge_meshes,
    outward,
    weld,
)

CUBE = box_mesh(np.array([0.5, 0.5, 0.5]))


def test_watertight_means_every_edge_has_its_opposite():
    assert is_watertight(CUBE)
    assert not is_watertight(Mesh(CUBE.vertices, CUBE.triangles[1:]))
    flipped = CUBE.triangles.copy()
    flipped[0] = flipped[0, ::-1]
    assert not is_watertight(Mesh(CUBE.vertices, flipped))


def test_outward_turns_an_inside_out_mesh():
    inside_out = Mesh(CUBE.vertices, CUBE.triangles[:, ::-1])
    assert outward(inside_out).volume() == pytest.approx(1.0)
    assert outward(CUBE) is CUBE


def test_weld_drops_doubled_vertices_and_collapsed_faces():
    soup = weld(
        CUBE.vertices[CUBE.triangles].reshape(-1, 3), np.arange(36).reshape(-1, 3)
    )
    assert len(soup.vertices) == 8
    assert is_watertight(soup)
    assert len(weld(np.zeros((3, 3)), np.array([[0, 1, 2]])).triangles) == 0


def test_merge_keeps_volume_and_shares_vertices():
    far = Mesh(CUBE.vertices + 5.0, CUBE.triangles)
    both = merge_meshes([CUBE, far])
    assert both.volume() == pytest.approx(2.0)
    assert len(merge_meshes([CUBE, CUBE]).vertices) == 8


def test_halves_of_a_cube_are_joined():
    halves = [Mesh(CUBE.vertices, CUBE.triangles[i::2]) for i in (0, 1)]
    meshes, note = close_meshes(halves)
    assert note == ""
    assert len(meshes) == 1
    assert meshes[0].volume() == pytest.approx(1.0)


def test_hole_is_filled_and_said():
    meshes, note = close_meshes([Mesh(CUBE.vertices, CUBE.triangles[1:])])
    assert "holes filled" in note
    assert meshes[0].volume() == pytest.approx(1.0)


def test_single_sheet_is_beyond_repair_and_said():
    square = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    meshes, note = close_meshes([square])
    assert note == "not closed"
    assert not is_watertight(meshes[0])
