# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.raycast import MeshScene
from sim_bridge.objects.affordance import load_affordance
from sim_bridge.objects.shapes.assembly import Shape, assemble
from sim_bridge.objects.shapes.building import box
from sim_bridge.objects.surface import sample_surface


def test_two_touching_boxes_show_no_points_where_they_touch():
    shape = Shape([box((1, 1, 1), (0, 0, 0)), box((1, 1, 1), (1, 0, 0))], 1.0)
    surface = sample_surface(assemble(shape, "a", "s"), 4000, np.random.default_rng(0))
    assert (
        len(surface.points) == len(surface.normals) == len(surface.part_index) == 4000
    )
    assert (np.abs(surface.points[:, 0]) > 1e-6).all()
    assert np.mean(surface.part_index) == pytest.approx(0.5, abs=0.03)
    on_ends = np.abs(surface.points[:, 0]) > 1 - 1e-9
    assert on_ends.mean() == pytest.approx(2 / 10, abs=0.03)
    np.testing.assert_allclose(surface.normals[on_ends, 0], surface.points[on_ends, 0])


def test_box_inside_another_is_never_seen():
    shape = Shape([box((1, 1, 1)), box((0.5, 0.5, 0.5))], 1.0)
    surface = sample_surface(assemble(shape, "a", "s"), 500, np.random.default_rng(0))
    assert (surface.part_index == 0).all()
    np.testing.assert_allclose(np.abs(surface.points).max(axis=1), 0.5)


@pytest.mark.parametrize(
    "name", ["mug/barrel/000001", "bag/tote/000002", "hat/cap/000003"]
)
def test_points_lie_just_outside_and_just_inside_the_union(name):
    model = load_affordance(name)
    surface = sample_surface(model, 400, np.random.default_rng(1))
    poses = np.broadcast_to(np.eye(4), (len(model.visuals), 4, 4))
    scene = MeshScene(model.visuals, poses)
    outside = scene.contains(surface.points + 1e-4 * surface.normals)
    inside = scene.contains(surface.points - 1e-4 * surface.normals)
    assert outside.mean() < 0.02
    assert inside.mean() > 0.95
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0)


def test_same_generator_same_points():
    model = load_affordance("knife/chef/000000")
    one, two = (sample_surface(model, 50, np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one.points, two.points)
