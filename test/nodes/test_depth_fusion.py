# SPDX-License-Identifier: Apache-2.0
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.fusion_rig import (  # noqa: E402
    SECOND,
    WORKSPACE,
    Rig,
    box_points,
    calibrated_rig,
)
from nodes.synthetic import (  # noqa: E402
    CAMERA,
    CAMERA_FRAME,
    camera_info,
    depth_image,
)
from rclpy.time import Time  # noqa: E402

from neugrasp_ros.nodes.compat.tf import Buffer, from_transform  # noqa: E402
from neugrasp_ros.nodes.compat.tf_buffer import (  # noqa: E402
    LookupException,
    to_transform,
)
from neugrasp_ros.nodes.depth_fusion import DepthFusion  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402


@pytest.fixture
def rig() -> Rig:
    return calibrated_rig()


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
    rig = calibrated_rig(view_mode=mode, max_weight=4)
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

    fusion = DepthFusion(
        rig.config, lookup, lambda: rig.time, lambda: rig.time / SECOND
    )
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
    assert not fusion.on_depth(late) and fusion.counts["no_tf"] == 0
    rig.time += SECOND
    assert not fusion.retry() and fusion.counts["no_tf"] == 1
    move(rig.time)
    assert not fusion.retry()  # it is not taken up again


def test_an_image_waits_for_its_tf_by_a_clock_that_simulated_time_does_not_hurry(rig):
    seconds = [10.0]
    has_tf = [False]

    def lookup(target, source, stamp):
        if not has_tf[0]:
            raise LookupException("not yet")
        return rig.scene.T_base_camera

    fusion = DepthFusion(rig.config, lookup, lambda: rig.time, lambda: seconds[0])
    fusion.on_camera_info(camera_info())
    image = depth_image(rig.scene.depth(), rig.time)
    fusion.on_depth(image)
    rig.time += 5 * SECOND  # simulated, in no time
    seconds[0] += 0.1
    has_tf[0] = True
    assert fusion.retry() and fusion.counts["no_tf"] == 0


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
    rig = calibrated_rig(max_rate=2.0)
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


def test_waiting_ends_when_nobody_wants_it_any_more(rig):
    start = time.monotonic()
    for view_is_there in (False, True):
        if view_is_there:
            rig.shoot()
        with pytest.raises(DetectionError, match="canceled while it waited") as caught:
            rig.fusion.wait(
                lambda v: False, start + 30, lambda: time.monotonic() > start + 0.2
            )
        assert caught.value.code is Code.CANCELED
    assert rig.fusion.wait(lambda v: True, start + 30, lambda: True).volume.view_count
    assert time.monotonic() - start < 5
