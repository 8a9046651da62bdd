# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ObjectFileError
from sim_bridge.objects.mesh_repair import is_watertight
from sim_bridge.objects.tessellation import (
    N_SIDES,
    hull_mesh,
    primitive_mesh,
    primitive_volume,
    revolved_mesh,
)

KINDS = [
    ("box", (0.01, 0.02, 0.03)),
    ("cylinder", (0.02, 0.1)),
    ("sphere", (0.03,)),
    ("capsule", (0.01, 0.05)),
]


@pytest.mark.parametrize(("kind", "size"), KINDS)
def test_primitives_are_closed_and_nearly_fill_their_exact_volume(kind, size):
    mesh = primitive_mesh(kind, size)
    assert is_watertight(mesh)
    exact = primitive_volume(kind, size)
    tolerance = 1e-12 if kind == "box" else 0.03
    assert (1 - tolerance) * exact <= mesh.volume() <= exact * (1 + 1e-12)


@pytest.mark.parametrize(("kind", "size"), KINDS)
def test_primitives_reach_as_far_as_their_size_says(kind, size):
    half_z = {"box": 0.03, "cylinder": 0.05, "sphere": 0.03, "capsule": 0.035}[kind]
    bounds = primitive_mesh(kind, size).bounds()
    np.testing.assert_allclose(bounds[:, 2], [-half_z, half_z])
    np.testing.assert_allclose(bounds[1, 0], size[0])


def test_volumes_are_those_of_the_formulas():
    assert primitive_volume("box", (1.0, 2.0, 3.0)) == 48.0
    assert primitive_volume("cylinder", (1.0, 2.0)) == pytest.approx(2 * np.pi)
    assert primitive_volume("sphere", (1.0,)) == pytest.approx(4 / 3 * np.pi)
    assert primitive_volume("capsule", (1.0, 2.0)) == pytest.approx(10 / 3 * np.pi)


def test_revolved_cone_has_the_volume_of_a_pyramid():
    cone = revolved_mesh(np.array([1.0, 0.0]), np.array([0.0, 3.0]))
    base = N_SIDES / 2 * np.sin(2 * np.pi / N_SIDES)
    assert is_watertight(cone)
    assert cone.volume() == pytest.approx(base)


def test_hull_of_a_cube_with_points_inside_is_the_cube():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    mesh = hull_mesh(np.concatenate([corners, [[0.5, 0.5, 0.5]]]).astype(float))
    assert is_watertight(mesh)
    assert len(mesh.vertices) == 8
    assert mesh.volume() == pytest.approx(1.0)


@pytest.mark.parametrize("points", [np.zeros((8, 3)), np.eye(3), np.zeros((0, 3))])
def test_points_without_volume_are_refused(points):
    with pytest.raises(ObjectFileError, match="do not span a convex volume"):
        hull_mesh(points)
