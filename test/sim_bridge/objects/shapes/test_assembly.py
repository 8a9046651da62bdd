# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from sim_bridge.objects.shapes.assembly import MASS_RANGE, Shape, assemble, seeded
from sim_bridge.objects.shapes.building import box, cylinder


def test_origin_is_the_centre_of_the_bounds_and_mass_is_volume_times_density():
    shape = Shape(
        [box((0.1, 0.1, 0.1), (1, 2, 3)), box((0.1, 0.1, 0.1), (1.2, 2, 3))], 200
    )
    model = assemble(shape, "a", "set", "category", "style")
    np.testing.assert_allclose(model.bounds().sum(axis=0), 0.0, atol=1e-12)
    assert model.mass == pytest.approx(0.4)
    np.testing.assert_allclose(model.center_of_mass, 0.0, atol=1e-12)
    assert (model.category, model.style, model.friction) == ("category", "style", 1.0)


def test_one_visual_mesh_per_part_at_the_same_place():
    model = assemble(Shape([cylinder(0.02, 0.1, (0, 0, 0.3))], 500), "a", "set")
    assert len(model.visuals) == len(model.parts) == 1
    assert model.parts[0].pose[2, 3] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("density", "mass"), [(1e-3, MASS_RANGE[0]), (1e6, MASS_RANGE[1])]
)
def test_mass_stays_in_what_an_arm_can_lift(density, mass):
    assert assemble(Shape([box((0.1, 0.1, 0.1))], density), "a", "set").mass == mass


def test_same_name_same_draws():
    assert seeded("mug_001").random() == seeded("mug_001").random()
    assert seeded("mug_001").random() != seeded("mug_002").random()
