# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.synthetic import CAMERA, CAMERA_FRAME, Scene  # noqa: E402

from neugrasp_ros.fusion.tsdf import empty_volume, integrate  # noqa: E402
from neugrasp_ros.geometry.transform import (  # noqa: E402
    apply,
    invert,
    make_transform,
    translation,
)
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.planner_stages import Box, in_box  # noqa: E402
from neugrasp_ros.nodes.scene_view import SceneView  # noqa: E402
from neugrasp_ros.nodes.settings import WorkspaceConfig  # noqa: E402
from neugrasp_ros.nodes.target_mask import MARGIN, Camera, Target  # noqa: E402

LEFT, RIGHT = np.array([0.15, 0.22, 0.07]), np.array([0.15, 0.08, 0.07])
WORKSPACE = WorkspaceConfig(rpy=(0.0, 0.0, 0.4))
SCENE = Scene(WORKSPACE)
T_FRAME_CAMERA = SCENE.T_base_camera


def mask_of(*boxes) -> Target:
    """Return the pixels in which boxes change the picture of the empty table."""
    SCENE.clear()
    empty = SCENE.depth()
    for box in boxes:
        SCENE.add_box(box)
    pixels = SCENE.depth() < empty - 1e-3
    return Target(pixels, Camera(CAMERA, CAMERA_FRAME))


def view_of(*boxes) -> SceneView:
    SCENE.clear()
    for box in boxes:
        SCENE.add_box(box)
    T_task_camera = invert(SCENE.T_base_task) @ T_FRAME_CAMERA
    volume = integrate(empty_volume(), SCENE.depth(), CAMERA, T_task_camera)
    return SceneView(
        volume=volume, T_frame_task=SCENE.T_base_task, frame_id="base_footprint",
        stamp=1, revision=1,
    )  # fmt: skip


def in_frame(*points) -> np.ndarray:
    return apply(SCENE.T_base_task, np.array(points))


def grasps_at(positions, contacts=None) -> GraspList:
    poses = make_transform(
        np.broadcast_to(np.eye(3), (len(positions), 3, 3)), positions
    )
    grasps = GraspSet(poses, np.full(len(positions), 0.05))
    info = GraspInfo(frame_id="base_footprint")
    if contacts is None:
        return GraspList(info, grasps)
    return GraspList(info, grasps, contacts=contacts)


def test_a_box_is_covered_by_its_mask_and_the_other_is_not():
    covered = mask_of(LEFT).covers(in_frame(LEFT, RIGHT), T_FRAME_CAMERA)
    assert covered.tolist() == [True, False]


def test_what_is_behind_or_beside_the_camera_or_nowhere_is_not_covered():
    target = Target(np.ones((120, 160), bool), Camera(CAMERA, CAMERA_FRAME))
    there = [[0, 0, 1], [0, 0, -1], [9, 0, 1], [0, -9, 1], [np.nan, 0, 1], [0, 0, 0]]
    points = apply(T_FRAME_CAMERA, np.array(there, dtype=float))
    covered = target.covers(points, T_FRAME_CAMERA)
    assert covered.tolist() == [True, False, False, False, False, False]


def test_the_region_holds_the_whole_box_and_keeps_off_the_other():
    region = mask_of(LEFT).region(view_of(LEFT, RIGHT), T_FRAME_CAMERA, None)
    signs = np.array(np.meshgrid(*[[-0.02, 0.02]] * 3)).reshape(3, -1).T
    assert in_box(in_frame(*(LEFT + signs)), region).all()
    assert not in_box(in_frame(RIGHT), region).any()
    assert (region.size > 2 * MARGIN).all()


def test_a_mask_over_nothing_seen_is_an_empty_workspace():
    view, target = view_of(RIGHT), mask_of(LEFT)
    elsewhere = translation(5.0, 0.0, 0.0) @ T_FRAME_CAMERA
    with pytest.raises(DetectionError, match="the mask covers no surface") as caught:
        target.region(view, elsewhere, None)
    assert caught.value.code is Code.EMPTY_WORKSPACE
    roi = Box(translation(*in_frame(RIGHT)[0]), np.full(3, 0.05))
    with pytest.raises(DetectionError, match="in the region of interest"):
        target.region(view, T_FRAME_CAMERA, roi)


def test_a_grasp_counts_by_the_middle_of_its_contacts_or_its_tcp():
    target = mask_of(LEFT)
    assert target.held_by(
        grasps_at(in_frame(LEFT, RIGHT)), T_FRAME_CAMERA
    ).tolist() == [True, False]
    aside = np.array([[0.0, 0.02, 0.0], [0.0, -0.02, 0.0]])
    contacts = np.array([in_frame(*(RIGHT + aside)), in_frame(*(LEFT + aside))])
    swapped = grasps_at(in_frame(LEFT, RIGHT), contacts)
    assert target.held_by(swapped, T_FRAME_CAMERA).tolist() == [False, True]
