# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from object_checks import count_pieces

from neugrasp_ros.errors import UnknownNameError
from sim_bridge.objects.affordance import (
    FIRST_HELD_OUT_SEED,
    MIXED,
    MIXED_MAKERS,
    STYLES,
    affordance_names,
    held_out_names,
    held_out_style,
    is_held_out,
    load_affordance,
    mixed_names,
    parse_name,
)
from sim_bridge.objects.affordances import PART_TABLE, part_affordances
from sim_bridge.objects.mesh_repair import is_watertight

KINDS = [(category, style) for category, styles in STYLES.items() for style in styles]
KINDS += [(category, MIXED) for category in MIXED_MAKERS]


def test_seven_categories_with_five_styles_or_more_beside_the_held_out():
    assert set(STYLES) == {
        "knife", "scissors", "mug", "bottle", "bag", "earphone", "hat",
    }  # fmt: skip
    assert all(len(styles) > 5 for styles in STYLES.values())


@pytest.mark.parametrize(("category", "style"), KINDS)
def test_objects_are_closed_sized_for_the_workspace_and_labelled(category, style):
    for seed in (0, 17, FIRST_HELD_OUT_SEED):
        model = load_affordance(f"{category}/{style}/{seed:06d}")
        assert (model.category, model.style) == (category, style)
        assert all(is_watertight(mesh) and mesh.volume() > 0 for mesh in model.visuals)
        assert len(model.visuals) == len(model.parts)
        assert 0.008 < model.extents().min() < 0.125
        assert model.extents().max() < 0.26
        assert 0.03 <= model.mass <= 0.8
        assert all(part_affordances(category, label) for label in model.part_labels())


@pytest.mark.parametrize(("category", "style"), KINDS)
def test_objects_are_in_one_piece(category, style):
    assert count_pieces(load_affordance(f"{category}/{style}/000003")) == 1


def test_every_label_of_the_table_occurs_before_the_held_out_style():
    for category, styles in STYLES.items():
        seen = {
            label
            for style in styles
            if style != held_out_style(category)
            for label in load_affordance(f"{category}/{style}/000000").part_labels()
        }
        assert seen == set(PART_TABLE[category])


def test_training_names_hold_nothing_out_and_held_out_names_nothing_else():
    train = affordance_names(3)
    assert len(train) == 3 * sum(len(styles) - 1 for styles in STYLES.values())
    assert not any(is_held_out(name) for name in train)
    test = held_out_names(2)
    assert all(is_held_out(name) for name in test)
    assert not set(train) & set(test)


def test_mixed_objects_are_of_all_categories_and_of_no_test():
    names = mixed_names(3)
    assert {parse_name(name).category for name in names} == set(STYLES)
    assert len(names) == 3 * len(STYLES)
    assert not any(is_held_out(name) for name in names)
    assert not set(names) & {*affordance_names(), *held_out_names()}


def test_new_and_known_styles_can_be_tested_apart():
    new, known = held_out_names(2, styles="new"), held_out_names(2, styles="known")
    assert len(new) == 2 * len(STYLES)
    assert sorted(new + known) == sorted(held_out_names(2))
    assert {parse_name(name).style for name in new} == {
        held_out_style(category) for category in STYLES
    }
    with pytest.raises(UnknownNameError, match="known: all, known, new"):
        held_out_names(styles="old")


def test_last_style_is_held_out_whatever_its_seed():
    assert held_out_style("mug") == "teacup"
    assert is_held_out("mug/teacup/000001")
    assert is_held_out("mug/barrel/1000000")
    assert not is_held_out("mug/barrel/999999")


def test_name_is_the_seed_and_shapes_vary():
    one, same = (load_affordance("hat/sun/000004") for _ in range(2))
    np.testing.assert_array_equal(one.bounds(), same.bounds())
    extents = [load_affordance(f"hat/sun/{k:06d}").extents() for k in range(6)]
    assert np.std(extents, axis=0).max() > 0.003


@pytest.mark.parametrize("name", ["mug", "mug/teapot/1", "spoon/a/1", "mug/teacup/x"])
def test_unknown_names_are_refused(name):
    with pytest.raises(UnknownNameError, match=r"mug/teacup/<seed>"):
        load_affordance(name)
