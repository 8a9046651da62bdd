# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest
from sim_shapes import block_set

from neugrasp_ros.errors import ConfigError, ShapeError, UnknownNameError
from neugrasp_ros.geometry.transform import translation
from sim_bridge.scene import (
    PlacedObject,
    Scene,
    physical_model,
    scene_from_record,
    scene_meshes,
)

SETS = {"blocks": block_set()}
SCENE = Scene(
    "pile",
    7,
    (
        PlacedObject("blocks", "ell", 0.9, translation(0.1, 0.1, 0.07)),
        PlacedObject("blocks", "cube", 0.5, translation(0.2, 0.1, 0.06)),
    ),
)


def test_a_scene_survives_json():
    again = scene_from_record(json.loads(json.dumps(SCENE.as_record())))
    assert again.as_record() == SCENE.as_record()


def test_meshes_are_scaled_posed_and_numbered_by_object():
    meshes, poses, owners = scene_meshes(SCENE, SETS)
    assert owners == (0, 0, 1)
    cube = meshes[2].transformed(poses[2]).bounds()
    np.testing.assert_allclose(cube, [[0.19, 0.09, 0.05], [0.21, 0.11, 0.07]])


def test_an_egad_object_collides_as_its_hull_with_the_benchmarks_mass():
    ell = SETS["blocks"].load("ell")
    physical = physical_model("egad", ell)
    assert [part.kind for part in physical.parts] == ["hull"]
    assert (physical.mass, physical.friction) == (0.15, 0.75)
    assert physical.visuals is ell.visuals
    assert physical_model("pile", ell) is ell


def test_bad_recipes_are_errors():
    with pytest.raises(UnknownNameError, match="heap"):
        Scene("heap", 0, ())
    with pytest.raises(ShapeError, match="T_task_object"):
        PlacedObject("blocks", "cube", 1.0, np.eye(3))
    record = SCENE.as_record()
    del record["objects"][0]["scale"]
    with pytest.raises(ConfigError, match="scale"):
        scene_from_record(record)
