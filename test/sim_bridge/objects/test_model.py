# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError
from sim_bridge.objects.model import (
    ObjectModel,
    Part,
    compound_mass,
    mesh_centroid,
    part_mesh,
    part_volume,
)


def shifted(x: float, y: float, z: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = (x, y, z)
    return pose


def two_boxes() -> ObjectModel:
    parts = (
        Part("box", (0.01, 0.01, 0.01), shifted(0, 0, 0)),
        Part("box", (0.01, 0.01, 0.03), shifted(0.05, 0, 0), "handle"),
    )
    meshes = tuple(part_mesh(part) for part in parts)
    return ObjectModel("two", "test", parts, meshes, 0.1)


def test_bounds_and_extents_cover_all_parts():
    model = two_boxes()
    np.testing.assert_allclose(
        model.bounds(), [[-0.01, -0.01, -0.03], [0.06, 0.01, 0.03]]
    )
    np.testing.assert_allclose(model.extents(), [0.07, 0.02, 0.06])
    assert model.part_labels() == ("", "handle")


def test_compound_mass_weighs_parts_by_volume():
    model = two_boxes()
    mass, center = compound_mass(model.parts, model.visuals, density=1000.0)
    assert mass == pytest.approx(1000 * (8e-6 + 24e-6))
    np.testing.assert_allclose(center, [0.0375, 0, 0], atol=1e-12)


def test_scaling_multiplies_lengths_and_leaves_mass_and_the_original():
    model = two_boxes()
    twice = model.scaled(2.0)
    np.testing.assert_allclose(twice.bounds(), 2 * model.bounds())
    assert part_volume(twice.parts[1]) == pytest.approx(8 * part_volume(model.parts[1]))
    np.testing.assert_allclose(
        part_mesh(twice.parts[1]).bounds()[1], [0.12, 0.02, 0.06]
    )
    assert twice.mass == model.mass
    assert model.parts[1].pose[0, 3] == 0.05
    assert model.scaled(1.0) is model


def test_scaled_hull_scales_its_vertices():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    part = Part("hull", (), shifted(1, 0, 0), vertices=points).scaled(0.5)
    assert part_volume(part) == pytest.approx(1 / 6 / 8)
    np.testing.assert_allclose(part_mesh(part).bounds()[0], [0.5, 0, 0])


def test_arrays_are_copies_that_cannot_be_written():
    pose = np.eye(4)
    part = Part("sphere", (0.01,), pose)
    pose[0, 3] = 1.0
    assert part.pose[0, 3] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        part.pose[0, 3] = 1.0


def test_centroid_of_a_tetrahedron_is_the_mean_of_its_corners():
    points = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]], dtype=float)
    mesh = part_mesh(Part("hull", (), vertices=points))
    np.testing.assert_allclose(mesh_centroid(mesh), [1, 1, 1])


@pytest.mark.parametrize(
    ("kind", "size", "message"),
    [
        ("cone", (1.0,), "known: box"),
        ("box", (0.1, 0.1), "needs 3 positive sizes"),
        ("sphere", (0.0,), "needs 1 positive"),
        ("hull", (), "a hull has vertices"),
    ],
)
def test_impossible_parts_are_refused(kind, size, message):
    with pytest.raises(ConfigError, match=message):
        Part(kind, size)


def test_object_without_mass_or_parts_is_refused():
    model = two_boxes()
    with pytest.raises(ConfigError, match="mass 0.0 is not positive"):
        ObjectModel("x", "test", model.parts, model.visuals, 0.0)
    with pytest.raises(ConfigError, match="has no parts"):
        ObjectModel("x", "test", (), (), 1.0)
