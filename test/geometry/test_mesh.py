# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.mesh import Mesh, box_mesh
from neugrasp_ros.geometry.transform import make_transform, random_rotation

BOX = box_mesh(np.array([0.1, 0.2, 0.3]))


def test_a_box_is_closed_outward_and_of_its_volume():
    assert BOX.volume() == pytest.approx(0.2 * 0.4 * 0.6)
    edges = np.concatenate(
        [BOX.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))]
    )
    directed = {tuple(edge) for edge in edges.tolist()}
    assert len(directed) == len(edges)
    assert directed == {(b, a) for a, b in directed}  # every edge has its neighbour
    np.testing.assert_allclose(BOX.bounds(), [[-0.1, -0.2, -0.3], [0.1, 0.2, 0.3]])


def test_scaling_and_moving_change_the_volume_as_they_must():
    T = make_transform(random_rotation(np.random.default_rng(0)), np.ones(3))
    assert BOX.transformed(T).volume() == pytest.approx(BOX.volume())
    assert BOX.scaled(2.0).volume() == pytest.approx(8 * BOX.volume())
    np.testing.assert_allclose(BOX.transformed(T).vertices.mean(axis=0), 1.0)


def test_a_mesh_owns_read_only_arrays():
    vertices = np.zeros((3, 3))
    mesh = Mesh(vertices, np.array([[0, 1, 2]]))
    vertices[:] = 1.0
    assert (mesh.vertices == 0.0).all()
    with pytest.raises(ValueError, match="read-only"):
        mesh.vertices[0, 0] = 1.0


@pytest.mark.parametrize(
    ("vertices", "triangles", "told"),
    [
        (np.zeros((3, 2)), np.zeros((1, 3)), "vertices"),
        (np.zeros((3, 3)), np.zeros((1, 4)), "triangles"),
        (np.zeros(3), np.zeros((1, 3)), "vertices"),
    ],
)
def test_wrong_shapes_are_rejected(vertices, triangles, told):
    with pytest.raises(ShapeError, match=rf"{told}: expected shape \(_, 3\)"):
        Mesh(vertices, triangles)
