# SPDX-License-Identifier: Apache-2.0
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.synthetic import (  # noqa: E402
    CAMERA,
    CAMERA_FRAME,
    Scene,
    camera_info,
    depth_image,
)
from rclpy.time import Time  # noqa: E402

from neugrasp_ros.fusion.tsdf import seen_surface  # noqa: E402
from neugrasp_ros.nodes.compat.tf import Buffer, from_transform  # noqa: E402
from neugrasp_ros.nodes.compat.tf_buffer import (  # noqa: E402
    LookupException,
    to_transform,
)
from neugrasp_ros.nodes.depth_fusion import DepthFusion  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.params import LiveConfig  # noqa: E402
from neugrasp_ros.nodes.settings import FusionConfig, WorkspaceConfig  # noqa: E402

WORKSPACE = WorkspaceConfig(frame="base", origin=(0.5, -0.15, 0.7))
SECOND = 10**9


class Rig:
    """A camera over a table, a clock in our hands."""

    def __init__(self, workspace=WORKSPACE, **options) -> None:
        self.scene = Scene(WORKSPACE)
        self.config = LiveConfig(FusionConfig(workspace=workspace, **options))
        self.time = 5 * SECOND
        self.has_tf = True
        self.fusion = DepthFusion(self.config, self.lookup, lambda: self.time)

    def lookup(self, target, source, stamp):
        if not self.has_tf:
            raise LookupException(f"frame {source!r} does not exist")
        return self.scene.T_base_camera

    def shoot(self, form="32FC1", **changes):
        self.time += SECOND // 10
        image = depth_image(self.scene.depth(), self.time, form)
        for name, value in changes.items():
            setattr(image, name, value)
        return self.fusion.on_depth(image)

    def reason(self) -> DetectionError:
        with pytest.raises(DetectionError) as caught:
            self.fusion.view()
        return caught.value


@pytest.fixture
def rig() -> Rig:
    rig = Rig()
    rig.fusion.on_camera_info(camera_info())
    return rig


def box_points(rig: Rig, center) -> np.ndarray:
    """Return seen surface points within 3 cm of a place in the task frame."""
    points, _ = seen_surface(rig.fusion.view().volume)
    return points[np.linalg.norm(points - center, axis=1) < 0.03]


def test_a_box_is_seen_where_it_stands(rig):
    rig.scene.add_box((0.15, 0.15, 0.07))
    assert rig.shoot()
    view = rig.fusion.view()
    assert (view.frame_id, view.stamp) == ("base", rig.time)
    assert view.volume.view_count == 1
    top = box_points(rig, [0.15, 0.15, 0.09])
    assert len(top) and abs(top[:, 2].max() - 0.09) < 0.004


def test_an_unchanged_scene_keeps_its_revision_and_renews_its_stamp(rig):
    rig.shoot()
    first = rig.fusion.view()
    assert not rig.shoot()
    second = rig.fusion.view()
    assert second.revision == first.revision and second.stamp > first.stamp
    rig.scene.add_box((0.15, 0.15, 0.07))
    assert rig.shoot()
    assert rig.fusion.view().revision > second.revision


@pytest.mark.parametrize("mode", ["latest", "fuse"])
def test_a_removed_box_leaves_no_ghost_and_a_new_one_appears(mode):
    rig = Rig(view_mode=mode, max_weight=4)
    rig.fusion.on_camera_info(camera_info())
    rig.scene.add_box((0.10, 0.15, 0.07))
    for _ in range(6):
        rig.shoot()
    assert len(box_points(rig, [0.10, 0.15, 0.09]))
    rig.scene.clear()
    rig.scene.add_box((0.20, 0.15, 0.07))
    for _ in range(8):
        rig.shoot()
    gone = box_points(rig, [0.10, 0.15, 0.09])
    assert not (gone[:, 2] > 0.06).any()
    assert len(box_points(rig, [0.20, 0.15, 0.09]))


def test_millimetres_and_metres_give_the_same_volume(rig):
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.shoot("32FC1")
    metres = rig.fusion.view().volume.distances
    rig.shoot("16UC1")
    millimetres = rig.fusion.view().volume.distances
    both = np.isfinite(metres) & np.isfinite(millimetres)
    assert both.sum() > 0.98 * np.isfinite(metres).sum()
    assert np.quantile(np.abs(metres - millimetres)[both], 0.99) < 0.05


def test_nothing_came_yet(rig):
    assert rig.reason().code is Code.NO_DEPTH


def test_no_camera_info():
    rig = Rig()
    rig.shoot()
    reason = rig.reason()
    assert reason.code is Code.NO_CAMERA_INFO and "has come" in reason.sentence


def test_an_uncalibrated_camera_says_so():
    rig = Rig()
    info = camera_info()
    info.k, info.p = [0.0] * 9, [0.0] * 12
    rig.fusion.on_camera_info(info)
    rig.shoot()
    assert "not calibrated" in rig.reason().sentence


@pytest.mark.parametrize(
    ("changes", "code", "sentence"),
    [
        ({"encoding": "rgb8"}, Code.NO_DEPTH, "encoding 'rgb8'; expected"),
        (
            {"height": CAMERA.height // 2},
            Code.NO_CAMERA_INFO,
            "but depth/camera_info says",
        ),
        ({"data": []}, Code.NO_DEPTH, "bytes, got 0"),
    ],
)
def test_an_image_that_cannot_be_used_says_why(rig, changes, code, sentence):
    rig.shoot(**changes)
    reason = rig.reason()
    assert reason.code is code and sentence in reason.sentence
    rig.shoot()
    rig.fusion.view()


def test_millimetres_in_a_float_image_are_noticed(rig):
    image = depth_image(rig.scene.depth() * 1000, rig.time + 1)
    rig.fusion.on_depth(image)
    assert "millimetres" in rig.reason().sentence


@pytest.mark.parametrize("value", [np.nan, np.inf, 0.0, -1.0])
def test_an_image_without_a_valid_pixel_observes_nothing(rig, value):
    depth = np.full((CAMERA.height, CAMERA.width), value, np.float32)
    rig.fusion.on_depth(depth_image(depth, rig.time))
    assert not rig.fusion.view().volume.observed.any()
    assert rig.fusion.valid_share == 0.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 0.0, -1.0])
def test_holes_observe_nothing_and_spoil_nothing_beside_them(rig, value):
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.shoot()
    whole = rig.fusion.view().volume
    depth = rig.scene.depth()
    depth[:, : CAMERA.width // 2] = value
    rig.time += SECOND
    rig.fusion.on_depth(depth_image(depth, rig.time))
    half = rig.fusion.view().volume
    share = half.observed.sum() / whole.observed.sum()
    assert 0.2 < share < 0.8 and not (half.observed & ~whole.observed).any()
    np.testing.assert_array_equal(
        half.distances[half.observed], whole.distances[half.observed]
    )


def test_tf_that_ends_before_the_image_is_waited_for_and_then_given_up(rig):
    buffer, T = Buffer(), rig.scene.T_base_camera

    def move(stamp: int) -> None:
        buffer.set_transform(to_transform(T, "base", CAMERA_FRAME, stamp), "")

    def lookup(target, source, stamp):
        there = Time(nanoseconds=stamp)
        return from_transform(buffer.lookup_transform(target, source, there))

    fusion = DepthFusion(rig.config, lookup, lambda: rig.time)
    fusion.on_camera_info(camera_info())
    image = depth_image(rig.scene.depth(), rig.time)
    move(rig.time - SECOND // 2)
    assert not fusion.on_depth(image)
    with pytest.raises(DetectionError, match="^base <- camera_optical: ") as caught:
        fusion.view()
    assert caught.value.code is Code.TF_ERROR
    rig.time += SECOND // 10  # within tf_timeout
    move(rig.time)
    assert fusion.retry() and fusion.view().stamp == rig.time - SECOND // 10
    late = depth_image(rig.scene.depth(), rig.time + SECOND // 2)
    rig.time += SECOND
    assert not fusion.on_depth(late) and fusion.counts["no_tf"] == 1
    move(rig.time)
    assert not fusion.retry()  # it is not taken up again


def test_missing_tf_names_the_link_and_late_tf_is_waited_for(rig):
    rig.has_tf = False
    rig.shoot()
    reason = rig.reason()
    assert reason.code is Code.TF_ERROR
    assert reason.sentence.startswith("base <- camera_optical: ")
    rig.has_tf = True
    assert rig.fusion.retry()
    assert rig.fusion.view().stamp == rig.time


def test_an_image_whose_tf_never_comes_is_dropped(rig):
    rig.has_tf = False
    rig.shoot()
    rig.time += SECOND
    rig.fusion.retry()
    assert rig.fusion.counts["no_tf"] == 1
    rig.has_tf = True
    assert not rig.fusion.retry()


def test_the_queue_for_tf_is_bounded(rig):
    rig.has_tf = False
    for _ in range(30):
        rig.shoot()
    assert rig.fusion.counts["no_tf"] >= 20


def test_old_depth_is_refused(rig):
    rig.shoot()
    rig.time += 3 * SECOND
    reason = rig.reason()
    assert reason.code is Code.STALE_DEPTH and "3.00 s old" in reason.sentence


def test_stamps_that_jump_back_start_afresh(rig):
    rig.shoot()
    rig.time -= 4 * SECOND
    rig.shoot()
    assert rig.fusion.view().stamp == rig.time


def test_reset_clears_and_the_revision_goes_on(rig):
    rig.shoot()
    before = rig.fusion.view().revision
    rig.fusion.reset()
    assert rig.reason().code is Code.NO_DEPTH
    rig.shoot()
    assert rig.fusion.view().revision > before


def test_too_many_images_are_thinned_out():
    rig = Rig(max_rate=2.0)
    rig.fusion.on_camera_info(camera_info())
    for _ in range(10):
        rig.shoot()
    counts = {"received": 10, "fused": 3, "skipped": 0, "no_tf": 0, "refused": 0}
    assert rig.fusion.counts == counts


def test_not_integrating_keeps_the_scene(rig):
    rig.shoot()
    before = rig.fusion.view().revision
    rig.config.current = replace(rig.config.current, integrating=False)
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.shoot()
    assert rig.fusion.view().revision == before


def test_borders_are_cut_and_infinity_may_carve(rig):
    depth = np.full((CAMERA.height, CAMERA.width), np.inf, np.float32)
    rig.config.current = replace(
        rig.config.current, carve_infinite=True, invalid_border=5
    )
    rig.fusion.on_depth(depth_image(depth, rig.time))
    volume = rig.fusion.view().volume
    assert (volume.distances[volume.observed] == 1.0).all()
    inside = (CAMERA.width - 10) * (CAMERA.height - 10) / (CAMERA.width * CAMERA.height)
    assert rig.fusion.valid_share == pytest.approx(inside)


def test_a_moved_workspace_takes_effect_with_the_next_image(rig):
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.shoot()
    moved = replace(WORKSPACE, origin=(0.45, -0.15, 0.7))
    rig.config.current = replace(rig.config.current, workspace=moved)
    rig.shoot()
    assert len(box_points(rig, [0.20, 0.15, 0.09]))


def test_waiting_ends_with_what_is_wanted_or_at_the_deadline(rig):
    rig.shoot()
    start = time.monotonic()
    view = rig.fusion.wait(lambda v: True, start + 5)
    assert time.monotonic() - start < 1
    stuck = rig.fusion.wait(lambda v: v.revision > view.revision, start + 0.2)
    assert stuck.revision == view.revision
    rig.fusion.reset()
    with pytest.raises(DetectionError, match="cleared"):
        rig.fusion.wait(lambda v: True, time.monotonic() + 0.05)


@pytest.mark.parametrize("mode", ["latest", "fuse"])
def test_a_view_from_nearly_the_same_place_is_skipped(mode):
    rig = Rig(view_mode=mode, min_motion=0.05)
    rig.fusion.on_camera_info(camera_info())
    rig.shoot()
    first = rig.fusion.view()
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.scene.T_base_camera[2, 3] += 0.04
    assert not rig.shoot()
    assert rig.fusion.view().stamp == first.stamp
    rig.scene.T_base_camera[2, 3] += 0.02
    assert rig.shoot()
    assert rig.fusion.counts["skipped"] == 1 and rig.fusion.counts["fused"] == 2
    rig.fusion.reset()
    assert rig.shoot()  # the first of a new scene is always taken
    rig.time += 3 * SECOND
    assert "views closer than min_motion, 0.05 m, are skipped" in rig.reason().sentence


def test_nothing_fused_cannot_be_saved(rig):
    with pytest.raises(DetectionError, match="nothing to save") as caught:
        rig.fusion.saved()
    assert caught.value.code is Code.NO_DEPTH


def test_a_loaded_scene_stays_until_the_next_image(rig):
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.shoot()
    saved = rig.fusion.saved()
    rig.scene.clear()
    rig.shoot()
    before = rig.fusion.view()
    rig.fusion.load(saved)
    rig.time += 60 * SECOND
    view = rig.fusion.view()
    assert view.revision > before.revision and view.stamp == rig.time - 60 * SECOND
    assert len(box_points(rig, [0.15, 0.15, 0.09]))
    rig.shoot()
    assert not len(box_points(rig, [0.15, 0.15, 0.09]))
    assert rig.fusion.view().stamp == rig.time
    rig.time += 3 * SECOND
    assert rig.reason().code is Code.STALE_DEPTH


def test_a_scene_of_another_workspace_keeps_its_place_and_is_not_fused_into():
    rig = Rig(view_mode="fuse")
    rig.fusion.on_camera_info(camera_info())
    rig.shoot()
    elsewhere = WorkspaceConfig(frame="map", origin=(1.0, 2.0, 3.0))
    rig.fusion.load(rig.fusion.saved()._replace(workspace=elsewhere))
    view = rig.fusion.view()
    assert view.frame_id == "map"
    np.testing.assert_allclose(view.T_frame_task[:3, 3], [1.0, 2.0, 3.0])
    rig.shoot()
    assert rig.fusion.view().frame_id == "base"
    assert rig.fusion.view().volume.view_count == 1


def test_a_workspace_is_found_around_what_stands_on_the_table():
    rig = Rig(
        workspace=WorkspaceConfig(frame="base", origin=(9.0, 9.0, 9.0), find=True)
    )
    rig.fusion.on_camera_info(camera_info())
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
    rig = Rig(workspace=WorkspaceConfig(frame="base", find=True))
    rig.fusion.on_camera_info(camera_info())
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
    rig = Rig(workspace=WorkspaceConfig(frame="base", find=True))
    rig.fusion.on_camera_info(camera_info())
    blank = np.full(rig.scene.depth().shape, np.nan, dtype=np.float32)
    rig.time += SECOND
    assert not rig.fusion.on_depth(depth_image(blank, rig.time))
    reason = rig.reason()
    assert reason.code == Code.EMPTY_WORKSPACE
    assert "no level plane" in reason.sentence
