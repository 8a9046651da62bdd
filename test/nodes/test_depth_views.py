# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.fusion_rig import SECOND, box_points, calibrated_rig  # noqa: E402
from nodes.synthetic import depth_image  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402

from neugrasp_ros.errors import DepthImageError  # noqa: E402
from neugrasp_ros.nodes.depth_views import clean, has_moved  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code  # noqa: E402
from neugrasp_ros.nodes.settings import FusionConfig, WorkspaceConfig  # noqa: E402


def test_what_is_out_of_range_or_at_the_border_is_not_used():
    depth = np.full((5, 6), 1.0, np.float32)
    depth[2, 2:5] = 0.1, 9.0, np.inf
    there = np.isfinite(clean(depth, FusionConfig(invalid_border=1)))
    assert there.sum() == 3 * 4 - 3 and not there[0].any() and not there[2, 2:5].any()
    carved = clean(depth, FusionConfig(carve_infinite=True, max_depth=2.0))
    assert carved[2, 4] == 2.0 and np.isnan(carved[2, 3])


def test_metres_that_can_only_be_millimetres_are_refused():
    with pytest.raises(DepthImageError, match="the median depth is 800 m"):
        clean(np.full((3, 3), 800.0, np.float32), FusionConfig())


@pytest.mark.parametrize(
    ("way", "angle", "moved"),
    [(0.0, 0.0, False), (0.04, 9.0, False), (0.06, 0.0, True), (0.0, 11.0, True)],
)
def test_a_camera_has_moved_where_it_went_or_turned_far_enough(way, angle, moved):
    before, now = np.eye(4), np.eye(4)
    before[:3, 3] = 1.0, -2.0, 0.5
    before[:3, :3] = Rotation.from_euler("xyz", [0.3, 1.0, -2.0]).as_matrix()
    turn = Rotation.from_rotvec(np.deg2rad([0.0, angle, 0.0])).as_matrix()
    now[:3, :3] = before[:3, :3] @ turn
    now[:3, 3] = before[:3, 3] + [0.0, 0.0, way]
    config = FusionConfig(min_motion=0.05, min_turn_deg=10.0)
    assert has_moved(before, now, config) is moved


def test_a_fused_view_from_nearly_the_same_place_only_renews_the_stamp():
    rig = calibrated_rig(view_mode="fuse", min_motion=0.05)
    rig.shoot()
    first = rig.fusion.view()
    for _ in range(30):  # longer than max_depth_age
        assert not rig.shoot()
    view = rig.fusion.view()
    assert view.stamp == rig.time and view.revision == first.revision
    rig.scene.T_base_camera[2, 3] += 0.06
    rig.shoot()
    assert rig.fusion.counts["skipped"] == 30 and rig.fusion.counts["fused"] == 2
    rig.fusion.reset()
    assert rig.shoot()  # the first of a new scene is always taken
    rig.shoot(encoding="rgb8")
    rig.time += 3 * SECOND
    assert "encoding 'rgb8'" in rig.reason().sentence  # looked at all the same


def test_where_the_latest_view_counts_a_camera_at_rest_sees_what_moves():
    rig = calibrated_rig(min_motion=0.05)
    rig.shoot()
    rig.scene.add_box((0.15, 0.15, 0.07))
    assert rig.shoot() and len(box_points(rig, [0.15, 0.15, 0.09]))
    assert not rig.fusion.counts["skipped"]


def test_a_workspace_is_found_around_what_stands_on_the_table():
    rig = calibrated_rig(
        workspace=WorkspaceConfig(frame="base", origin=(9.0, 9.0, 9.0), find=True)
    )
    rig.scene.add_box((0.15, 0.15, 0.07))
    assert rig.shoot()
    view = rig.fusion.view()
    T_task_found = np.linalg.inv(rig.scene.T_base_task) @ view.T_frame_task
    assert T_task_found[2, 3] == pytest.approx(0.0, abs=0.01)  # 5 cm below the table
    middle = T_task_found[:2, 3] + view.volume.size[:2] / 2
    np.testing.assert_allclose(middle, 0.15, atol=0.02)
    np.testing.assert_allclose(view.volume.size, 0.3, atol=0.005)
    assert len(box_points(rig, np.array([0.15, 0.15, 0.07]) - T_task_found[:3, 3])) > 20


def test_a_found_workspace_stays_until_the_scene_is_reset():
    rig = calibrated_rig(workspace=WorkspaceConfig(frame="base", find=True))
    rig.scene.add_box((0.15, 0.15, 0.07))
    assert rig.shoot()
    before = rig.fusion.view().T_frame_task
    rig.scene.clear()
    rig.scene.add_box((0.35, 0.15, 0.07))
    rig.shoot()
    np.testing.assert_array_equal(rig.fusion.view().T_frame_task, before)
    rig.fusion.reset()
    rig.shoot()
    moved = rig.fusion.view().T_frame_task[0, 3] - before[0, 3]
    assert moved > 0.1


def test_without_a_level_plane_no_workspace_is_found():
    rig = calibrated_rig(workspace=WorkspaceConfig(frame="base", find=True))
    blank = np.full(rig.scene.depth().shape, np.nan, dtype=np.float32)
    rig.time += SECOND
    assert not rig.fusion.on_depth(depth_image(blank, rig.time))
    reason = rig.reason()
    assert reason.code == Code.EMPTY_WORKSPACE
    assert "no level plane" in reason.sentence
