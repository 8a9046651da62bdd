# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from object_checks import count_pieces

from neugrasp_ros.errors import UnknownNameError
from sim_bridge.objects.mesh_repair import is_watertight
from sim_bridge.objects.procedural import (
    FAMILIES,
    load_procedural,
    procedural_names,
)
from sim_bridge.objects.registry import split

GRASPABLE = 0.07  # of an 80 mm jaw [m]
OPEN_ABOVE = {"bowl", "cup", "mug", "plate", "pot", "pitcher"}  # held by their rim


def test_set_has_hundreds_of_names_from_many_families_in_every_split():
    names = procedural_names()
    assert len(set(names)) == len(names) >= 400
    assert len(FAMILIES) >= 10
    for part in ("train", "tune", "val"):
        families = {name.rpartition("_")[0] for name in split(names, part)}
        assert len(families) >= 10


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_objects_are_closed_household_sized_and_centred(family):
    for number in (0, 7, 123):
        model = load_procedural(f"{family}_{number:03d}")
        assert all(is_watertight(mesh) and mesh.volume() > 0 for mesh in model.visuals)
        assert len(model.visuals) == len(model.parts)
        assert (model.extents() > 0.006).all()
        assert model.extents().max() < 0.26
        np.testing.assert_allclose(model.bounds().sum(axis=0), 0.0, atol=1e-9)
        assert 0.03 <= model.mass <= 0.8
        assert model.friction == 1.0
        lower, upper = model.bounds()
        assert ((model.center_of_mass > lower) & (model.center_of_mass < upper)).all()


def test_nearly_all_objects_fit_between_the_fingers():
    names = procedural_names()[::13]
    models = [load_procedural(name) for name in names]
    fits = [
        model.extents().min() <= GRASPABLE or model.category in OPEN_ABOVE
        for model in models
    ]
    assert np.mean(fits) > 0.97


@pytest.mark.parametrize("family", sorted(FAMILIES))
def test_objects_are_in_one_piece(family):
    assert count_pieces(load_procedural(f"{family}_005")) == 1


def test_name_is_the_seed():
    one, same = load_procedural("mug_003"), load_procedural("mug_003")
    np.testing.assert_array_equal(one.bounds(), same.bounds())
    assert one.mass == same.mass
    other = load_procedural("mug_004")
    assert not np.allclose(one.extents(), other.extents())


@pytest.mark.parametrize("name", ["mug", "mug_", "mug_x", "rocket_001", "mug_-1"])
def test_unknown_names_are_refused(name):
    with pytest.raises(UnknownNameError, match="mug_<number>"):
        load_procedural(name)
