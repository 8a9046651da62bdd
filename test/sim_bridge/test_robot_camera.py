# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.robot.link_meshes import LinkMeshes, VisualMeshes
from sim_bridge.furniture import BINS, FURNITURE
from sim_bridge.robot_camera import Bystander, Parts, RobotCamera, open_to_view
from sim_bridge.robot_cell import HEAD_JOINTS

pytestmark = pytest.mark.filterwarnings("ignore:Gimbal lock")

FRAME = "head_front_camera_rgb_optical_frame"


@pytest.fixture
def camera(tiago):
    links = LinkMeshes(tiago, without=HEAD_JOINTS)
    return RobotCamera(
        Intrinsics.from_hfov(64, 48, np.deg2rad(63.0)),
        lambda q: tiago.frame_pose(q, FRAME),
        Parts(links.meshes, links.poses),
    )


def test_the_middle_of_the_image_is_as_far_as_the_table(cell, camera, tiago):
    cell.spawn("table", 2, 0)
    snapshot = cell.snapshot
    T = tiago.frame_pose(snapshot.robot.q, FRAME)
    along = (0.70 - T[2, 3]) / T[2, 2]  # down the optical axis to the table top
    depth = camera.depth(snapshot)
    assert depth.shape == (48, 64)
    assert depth[23:25, 31:33].mean() == pytest.approx(along, abs=0.02)
    assert camera.labels(snapshot).max() == 0


def test_objects_are_labelled_and_stand_above_the_table(cell, camera):
    cell.spawn("table:packed", 2, 3)
    labels = camera.labels(cell.snapshot)
    assert set(np.unique(labels)) - {0} <= set(range(1, 1 + len(cell.snapshot.names)))
    assert labels.max() > 0


def test_a_still_scene_is_drawn_once_and_a_moved_head_again(cell, camera):
    cell.spawn("table", 2, 0)
    cell.advance(1.0)
    camera.depth(cell.snapshot)
    cell.advance(0.1)
    camera.depth(cell.snapshot)
    assert camera.renderings == 1
    drive = cell.drives["head_controller"]
    drive.start(drive.read(np.array([1.0]), drive.target[None] + 0.1), cell.now)
    cell.advance(1.0)
    camera.depth(cell.snapshot)
    assert camera.renderings == 2


def test_a_bystander_sees_robot_furniture_and_objects_in_colour(cell, tiago):
    cell.spawn("table:packed", 2, 3)
    look = VisualMeshes(tiago)
    by = Bystander(Parts(look.meshes, look.poses), look.colors, width=80, height=60)
    picture = by.photo(cell.snapshot)
    assert picture.shape == (60, 80, 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


@pytest.mark.parametrize(
    ("name", "hidden"), [("table", 0), ("cupboard", 0), ("shelf", 2)]
)
def test_walls_before_the_bystander_are_left_out(name, hidden):
    furniture = FURNITURE[name]
    own = (furniture.support, *furniture.others, *furniture.later)
    boxes = tuple(block for bin_ in BINS.values() for block in bin_.blocks())
    shown = open_to_view((*own, *boxes))
    assert len(shown) == len(own) + len(boxes) - hidden
    assert shown[0] is furniture.support
    for block in own:
        if all(block is not other for other in shown):  # back, and the side before him
            assert block.size.min() == 0.02 and block.size[2] > 1.0
