# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.collision import hand_measures
from neugrasp_ros.grasp.jaw_sweep import SweepSettings, jaw_content, sweep_depths

PANDA = load_gripper("panda")
HAND = hand_measures(PANDA)
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])
SETTINGS = SweepSettings(PANDA.max_opening, 0.2, 0.012, 0.006, 0.0, 0.004, 0.01, 0.01)


def box_cloud(*half_extents):
    scene = MeshScene([box_mesh(np.array(half_extents))], np.eye(4)[None])
    points, normals, _ = scene.sample_surface(20000, np.random.default_rng(0))
    return np.concatenate([points, normals], axis=1)


def sweep(cloud, pose, centered=False, settings=SETTINGS):
    found = sweep_depths(
        cloud[:, :3], pose[None, :3, 3], pose[None], np.array([1]),
        np.array([centered]), HAND, settings,
    )  # fmt: skip
    return [float(column[0]) for column in found]


def test_a_hand_above_a_box_centres_and_stops_at_the_palm():
    cloud = box_cloud(0.03, 0.02, 0.04)
    shift, shallow, deep = sweep(cloud, translation(0.0, 0.012, 0.04) @ DOWN)
    assert shift == pytest.approx(0.012, abs=2e-3)  # the hand's y points to -y
    assert shallow == pytest.approx(0.006, abs=1e-3)
    assert deep == pytest.approx(PANDA.finger_depth - 0.004, abs=1e-3)


def test_a_hand_that_keeps_its_place_is_stopped_by_its_finger():
    cloud = box_cloud(0.03, 0.02, 0.04)
    pose = translation(0.0, 0.03, 0.04) @ DOWN
    shift, _, deep = sweep(cloud, pose, centered=True)
    assert shift == 0.0
    assert deep == pytest.approx(0.0, abs=1e-3)


def test_a_box_wider_than_the_jaws_stops_both_fingers_at_its_top():
    cloud = box_cloud(0.03, 0.06, 0.04)
    _, shallow, deep = sweep(cloud, translation(0.0, 0.0, 0.04) @ DOWN)
    assert deep < shallow
    impatient = SETTINGS._replace(slack=0.0)
    pose = translation(0.0, 0.0, 0.04) @ DOWN
    assert sweep(cloud, pose, settings=impatient)[1] == np.inf


def test_jaws_see_extent_and_alignment_of_what_they_enclose():
    cloud = box_cloud(0.03, 0.02, 0.04)
    turned = translation(0.0, 0.0, 0.02) @ DOWN
    angle = 0.4
    turned[:3, :3] = turned[:3, :3] @ np.array(
        [
            [np.cos(angle), -np.sin(angle), 0],
            [np.sin(angle), np.cos(angle), 0],
            [0, 0, 1],
        ]
    )
    beside = translation(0.0, 0.2, 0.02) @ DOWN
    poses = np.stack([translation(0.0, 0.005, 0.02) @ DOWN, turned, beside])
    content = jaw_content(cloud, poses, PANDA.max_opening, HAND)
    assert content.upper[0] - content.lower[0] == pytest.approx(0.04, abs=1e-3)
    assert content.upper[0] + content.lower[0] == pytest.approx(0.01, abs=1e-3)
    assert content.alignment[0] == pytest.approx(1.0, abs=1e-6)
    assert content.alignment[1] == pytest.approx(np.cos(angle), abs=0.02)
    assert not np.isfinite(content.lower[2])
    assert content.alignment[2] == 0.0
