# SPDX-License-Identifier: Apache-2.0
import zlib

import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError, ObjectFileError, UnknownNameError
from sim_bridge.objects.affordance import is_held_out
from sim_bridge.objects.registry import (
    HELD_OUT,
    ObjectSet,
    object_set,
    part_names,
    split,
)

BOX_URDF = (
    '<robot name="x"><link name="a"><collision><geometry><box size="0.1 0.1 0.1"/>'
    "</geometry></collision></link></robot>"
)


def test_split_follows_the_hash_of_the_name_and_covers_everything():
    names = [f"object_{k}" for k in range(400)]
    parts = {part: split(names, part) for part in ("train", "tune", "val")}
    assert all(zlib.crc32(name.encode()) % 8 == 0 for name in parts["val"])
    assert all(zlib.crc32(name.encode()) % 8 == 1 for name in parts["tune"])
    assert sorted(n for part in parts.values() for n in part) == sorted(names)
    assert len(set(parts["val"]) | set(parts["tune"]) | set(parts["train"])) == 400


def test_unknown_split_is_refused():
    with pytest.raises(UnknownNameError, match="known: train, tune, val"):
        split(["a"], "test")


def test_generated_sets_are_known_by_name():
    for name in ("procedural", "affordance"):
        objects = object_set(name)
        assert objects.name == name
        assert list(objects.names) == sorted(objects.names)
        assert len(objects) >= 400
        assert objects.load(objects.names[0]) is objects.load(objects.names[0])


def test_random_urdfs_are_unions_of_closed_convex_pieces():
    objects = object_set("random_urdfs")
    assert len(objects) == 999
    assert "168" not in objects.names
    model = objects.load("000")
    assert len(model.parts) == len(model.visuals) == 5
    assert model.mass == 0.1
    assert (model.extents() < 0.2).all()


def test_folder_of_urdfs_is_called_like_its_last_component(tmp_path):
    folder = tmp_path / "kitchen"
    folder.mkdir()
    (folder / "crate.urdf").write_text(BOX_URDF)
    objects = object_set(str(folder))
    assert (objects.name, objects.names) == ("kitchen", ("crate",))
    np.testing.assert_allclose(objects.load("crate").extents(), 0.1)
    with pytest.raises(UnknownNameError, match="object of kitchen 'crat'.*crate"):
        objects.load("crat")


def test_folder_of_meshes_is_loaded(tmp_path):
    (tmp_path / "wedge.obj").write_text(
        "v 0 0 0\nv 90 0 0\nv 0 90 0\nv 0 0 90\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
    )
    model = object_set(str(tmp_path)).load("wedge")
    np.testing.assert_allclose(model.extents(), 0.09)


def test_one_broken_file_spoils_only_itself(tmp_path):
    (tmp_path / "good.urdf").write_text(BOX_URDF)
    (tmp_path / "bad.urdf").write_text("<robot")
    objects = object_set(str(tmp_path))
    assert objects.load("good").mass > 0
    with pytest.raises(ObjectFileError, match="bad.urdf"):
        objects.load("bad")


def test_folders_are_searched_where_the_environment_says(tmp_path, monkeypatch):
    (tmp_path / "garage").mkdir()
    (tmp_path / "garage" / "crate.urdf").write_text(BOX_URDF)
    monkeypatch.setenv("NEUGRASP_OBJECTS", f"/nowhere:{tmp_path}")
    assert object_set("garage").names == ("crate",)


def test_empty_folder_and_unknown_name_say_what_was_expected(tmp_path):
    with pytest.raises(ObjectFileError, match="holds no"):
        object_set(str(tmp_path))
    with pytest.raises(
        UnknownNameError, match="known: affordance, affordance_mixed, or a"
    ):
        object_set("proceduralistic")


def test_set_sorts_its_names_and_loads_each_once():
    loaded = []
    objects = ObjectSet("x", ["b", "a"], lambda name: loaded.append(name))
    assert objects.names == ("a", "b")
    objects.load("b")
    objects.load("b")
    assert loaded == ["b"]


def test_affordance_set_of_some_categories_keeps_its_name_and_only_these():
    objects = object_set("affordance/knife+mug")
    assert objects.name == "affordance"
    assert {name.partition("/")[0] for name in objects.names} == {"knife", "mug"}
    held_out = part_names(objects, HELD_OUT)
    assert {name.partition("/")[0] for name in held_out} == {"knife", "mug"}
    assert set(held_out) < set(part_names(object_set("affordance"), HELD_OUT))
    with pytest.raises(UnknownNameError, match="unknown category 'fork'; known: bag"):
        object_set("affordance/fork")


@pytest.mark.slow
def test_a_mass_leaves_the_heavier_objects_of_a_set():
    whole, heavy = object_set("procedural"), object_set("procedural@0.3")
    assert heavy.name == whole.name
    assert 0 < len(heavy) < len(whole)
    for name in whole.names[::20]:
        assert (name in heavy.names) == (whole.load(name).mass >= 0.3)
    with pytest.raises(ConfigError, match="has no object of 1000.0 kg"):
        object_set("procedural@1000")


@pytest.mark.parametrize("mass", ["much", "", "-1", "0", "nan", "inf"])
def test_a_mass_that_no_object_can_have_is_refused(mass):
    with pytest.raises(ConfigError, match=f"'{mass}' is no mass in kg"):
        object_set(f"procedural@{mass}")


def test_held_out_objects_are_those_never_learned_from():
    names = part_names(object_set("affordance"), HELD_OUT)
    assert names and all(is_held_out(name) for name in names)
    learned = part_names(object_set("affordance"), "train")
    assert learned and not any(is_held_out(name) for name in learned)
    with pytest.raises(ConfigError, match="'held_out' of 'procedural' is empty"):
        part_names(object_set("procedural"), HELD_OUT)


def test_mixed_affordance_objects_are_of_the_set_affordance_but_not_of_its_names():
    mixed = object_set("affordance_mixed/hat")
    assert mixed.name == "affordance"
    assert {name.rpartition("/")[0] for name in mixed.names} == {"hat/mixed"}
    assert not set(mixed.names) & set(object_set("affordance").names)
    assert 0 < len(part_names(mixed, "train")) < len(mixed)
    for part in ("val", "tune", HELD_OUT):
        with pytest.raises(ConfigError, match=f"training alone, not for '{part}'"):
            part_names(mixed, part)
