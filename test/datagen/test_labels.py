# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from sim_shapes import block_set

from neugrasp_ros.datagen.candidates import CandidateConfig
from neugrasp_ros.datagen.labels import (
    NOT_TRIED,
    REASONS,
    VARIED,
    WITHOUT_PHYSICS,
    SceneJob,
    label_scene,
)
from neugrasp_ros.datagen.shards import GRASP_FIELDS
from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.gripper import load_gripper
from sim_bridge.objects.registry import SPLIT_REMAINDERS

JOB = SceneJob(
    index=4, seed=1, kind="packed", objects="blocks", split="train", gripper="panda",
    candidates=CandidateConfig(n_trials=12, n_collisions=4, n_points=3000),
)  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def every_block_is_for_training():
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(SPLIT_REMAINDERS, "train", tuple(range(8)))
        yield


def label(job=JOB):
    return label_scene(job, {"blocks": block_set()})


@pytest.fixture(scope="module")
def labelled():
    return label()


def test_a_scene_gets_positive_and_negative_labels(labelled):
    grasps = labelled.grasps
    assert labelled.index == 4
    assert labelled.gripper == load_gripper("panda")
    assert labelled.scene.kind == "packed"
    assert 10 <= len(grasps) <= 16
    assert 0 < grasps.labels.sum() < len(grasps)
    assert ((grasps.reasons == REASONS.index("success")) == (grasps.labels == 1)).all()


def test_what_was_lifted_is_known_and_was_between_the_pads(labelled):
    grasps = labelled.grasps
    held = grasps.labels == 1
    assert (grasps.object_ids[held] >= 0).all()
    assert (grasps.object_ids[~held] == -1).all()
    assert (grasps.widths[held] > 0.008).all()
    assert set(grasps.shake_held[held]) <= {0, 1}
    assert set(grasps.shake_held[~held]) <= {-1}


def test_what_is_not_tried_collides_and_has_no_outcome(labelled):
    grasps = labelled.grasps
    left = ~grasps.tried
    assert grasps.hits_pregrasp[left].all()
    assert np.isnan(grasps.widths[left]).all()
    assert np.isfinite(grasps.widths[~left]).all()
    assert (grasps.labels[left] == 0).all()
    assert not (grasps.hits_pregrasp & ~grasps.hits_approach).any()


def test_without_physics_the_same_grasps_get_what_geometry_tells(labelled):
    grasps = label(dataclasses.replace(JOB, preset=WITHOUT_PHYSICS)).grasps
    np.testing.assert_array_equal(grasps.positions, labelled.grasps.positions)
    np.testing.assert_array_equal(grasps.hits_grasp, labelled.grasps.hits_grasp)
    assert not grasps.tried.any() and not grasps.labels.any()
    np.testing.assert_array_equal(grasps.judged(), ~labelled.grasps.tried)
    assert labelled.grasps.judged().all()
    waiting = grasps.reasons == REASONS.index(NOT_TRIED)
    np.testing.assert_array_equal(waiting, labelled.grasps.tried)


@pytest.mark.slow
def test_the_job_alone_determines_the_labels(labelled):
    again = label()
    for name in GRASP_FIELDS:
        np.testing.assert_array_equal(
            getattr(again.grasps, name), getattr(labelled.grasps, name)
        )
    other = label(dataclasses.replace(JOB, index=5))
    assert len(other.scene.objects) != len(again.scene.objects) or not np.array_equal(
        other.scene.objects[0].T_task_object, again.scene.objects[0].T_task_object
    )


def test_some_jaws_are_half_open_and_all_fit_the_gripper(labelled):
    openings = labelled.grasps.openings
    full = labelled.gripper.max_opening
    assert (openings >= 0.39 * full).all()
    assert (openings <= full + 1e-6).all()
    assert 0 < (openings < 0.99 * full).sum() < len(openings)


def test_a_varied_gripper_is_another_one_in_every_scene():
    scenes = [
        label(dataclasses.replace(JOB, index=index, gripper=VARIED)) for index in (4, 6)
    ]
    one, other = (scene.gripper for scene in scenes)
    assert one.name == other.name == "varied"
    assert one.max_opening != other.max_opening


def test_there_are_as_many_objects_as_asked_for():
    scene = label(dataclasses.replace(JOB, count=1, preset=WITHOUT_PHYSICS))
    assert len(scene.scene.objects) == 1


@pytest.mark.slow
def test_grasps_on_parts_of_labelled_things_say_what_they_afford():
    job = dataclasses.replace(JOB, objects="affordance", index=0)
    scene = label_scene(job)
    held = scene.grasps.affordances[scene.grasps.labels == 1]
    assert held.shape[1] == 7
    assert held.any()
    assert not label().grasps.affordances.any()


def test_columns_of_unequal_length_are_refused(labelled):
    with pytest.raises(ShapeError, match="widths"):
        dataclasses.replace(labelled.grasps, widths=np.zeros(1, dtype=np.float32))
