# SPDX-License-Identifier: Apache-2.0
"""The whole pipeline in one process over real DDS; planner and robot in closed form."""

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from builtin_interfaces.msg import Duration  # noqa: E402
from geometry_msgs.msg import PoseStamped, Vector3  # noqa: E402
from neugrasp_msgs.msg import DetectionReport, GraspArray  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from nodes.bench import (  # noqa: E402
    LEFT,
    ORIGIN,
    RIGHT,
    ask,
    begin,
    duration,
    mask_of,
    positions,
)

pytestmark = pytest.mark.ros


@pytest.fixture(autouse=True)
def usual(bench, wait_until):
    """Begin each test with both boxes seen, whatever the one before did."""
    begin(bench, wait_until)


def test_a_grasp_on_each_box_with_a_full_report(bench, wait_until):
    bench.show(LEFT, RIGHT)
    wait_until(lambda: ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).success)
    response = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH)
    report, array = response.report, response.grasps
    assert response.success and report.code == DetectionReport.NONE
    assert report.views == 1 and report.sampled >= report.after_quality > 0
    assert report.after_reachability == report.after_affordance >= len(array.grasps)
    assert report.seconds_total > 0 and report.seconds_reachability > 0
    assert array.header.frame_id == "base_footprint"
    assert array.stage == GraspArray.STAGE_REACHABLE
    assert array.axes == GraspArray.AXES_X_APPROACH_Y_CLOSING
    assert array.gripper == "robotiq_2f85" and array.joint_names
    arms = {g.arm for g in array.grasps}
    assert arms == {"arm_left_torso", "arm_right_torso"}
    qualities = [g.quality for g in array.grasps]
    assert qualities == sorted(qualities, reverse=True)
    approach = [g.pose.orientation for g in array.grasps][0]  # x axis points down
    assert 2 * (approach.x * approach.z - approach.w * approach.y) == pytest.approx(-1)
    where = positions(response) - ORIGIN
    for box in (LEFT, RIGHT):
        assert np.linalg.norm(where[:, :2] - box[:2], axis=1).min() < 0.03


def test_an_object_that_is_gone_has_no_grasp_in_a_fresh_view(bench):
    bench.show(LEFT, RIGHT)
    ask(bench, scene=DetectGrasps.Request.SCENE_FRESH)
    bench.show(RIGHT)
    response = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH)
    gone = np.array(LEFT) + ORIGIN
    assert response.success
    assert np.linalg.norm(positions(response)[:, :2] - gone[:2], axis=1).min() > 0.05


def test_after_an_execution_the_server_asks_for_a_fresh_view_by_itself(
    bench, wait_until
):
    bench.show(LEFT, RIGHT)
    array = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).grasps
    executed = bench.user.create_publisher(GraspArray, "grasps/executed", 1)
    wait_until(lambda: executed.get_subscription_count())
    bench.camera.sends = {"info"}
    executed.publish(array)
    wait_until(
        lambda: (
            ask(bench, timeout=duration(0.2)).report.code
            in (DetectionReport.TIMEOUT, DetectionReport.STALE_DEPTH)
        )
    )
    bench.camera.sends = {"depth", "info"}
    assert ask(bench).success


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"min_quality": float("nan")}, "min_quality must be within 0..1"),
        ({"min_quality": 1.5}, "min_quality must be within 0..1"),
        ({"min_affordance": float("nan")}, "min_affordance must be within"),
        ({"roi_size": Vector3(x=-0.1, y=0.1, z=0.1)}, "roi_size must be positive"),
        ({"roi_size": Vector3(x=float("nan"))}, "roi_size must be positive"),
        ({"roi_size": Vector3(x=0.1)}, "roi_size has a zero edge"),
        ({"reachability": 7}, "reachability must be 0, 1 or 2"),
        ({"scene": 9}, "scene must be 0, 1 or 2"),
        ({"timeout": Duration(sec=-1)}, "timeout must not be negative"),
        ({"max_candidates": 10**6}, "max_candidates must be at most 10000"),
        ({"arms": ["arm_middle"]}, "unknown arm 'arm_middle'; known: arm_left_torso"),
    ],
)
def test_a_bad_field_is_named(bench, fields, sentence):
    bench.show(LEFT)
    report = ask(bench, **fields).report
    assert report.code == DetectionReport.INVALID_REQUEST
    assert sentence in report.message and not report.sampled
    assert ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).success


def test_an_unknown_affordance_lists_the_vocabulary(bench):
    report = ask(bench, affordance="fly").report
    assert report.code == DetectionReport.UNKNOWN_AFFORDANCE
    assert "'fly'; known: " in report.message


def test_an_empty_table_and_a_region_without_anything(bench):
    bench.show()
    report = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).report
    assert report.code == DetectionReport.EMPTY_WORKSPACE
    assert "no surface was seen in it above the support" in report.message
    bench.show(LEFT)
    roi = PoseStamped()
    roi.header.frame_id = "base_footprint"
    roi.pose.position.x, roi.pose.position.y, roi.pose.position.z = (
        ORIGIN + RIGHT
    ).tolist()
    edges = {"roi_size": Vector3(x=0.08, y=0.08, z=0.08), "roi_pose": roi}
    report = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH, **edges).report
    assert report.code == DetectionReport.EMPTY_WORKSPACE
    assert "region of interest" in report.message
    bench.show(LEFT, RIGHT)
    found = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH, **edges)
    assert found.success and (positions(found)[:, 1] < 0).all()


def test_everything_outside_the_workspace_is_an_empty_workspace(bench):
    bench.show((0.15, 0.55, 0.07))
    report = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).report
    assert report.code == DetectionReport.EMPTY_WORKSPACE


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 0.0])
def test_an_image_without_a_measured_pixel(bench, value):
    def ruin(image):
        image.data = np.full(len(image.data) // 4, value, "<f4").tobytes()
        return image

    bench.camera.edit = ruin
    report = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).report
    assert report.code == DetectionReport.EMPTY_WORKSPACE
    assert "nothing inside the workspace was measured" in report.message


def rename(image):
    image.encoding = "rgb8"
    return image


def shrink(image):
    image.height //= 2
    return image


@pytest.mark.parametrize(
    ("edit", "code", "sentence"),
    [
        (rename, DetectionReport.NO_DEPTH, "encoding 'rgb8'"),
        (shrink, DetectionReport.NO_CAMERA_INFO, "depth/camera_info says 160x120"),
    ],
)
def test_images_that_do_not_fit_say_why_once_the_last_good_one_is_old(
    bench, edit, code, sentence
):
    bench.camera.edit = edit
    bench.allow_age(1.0)
    report = ask(
        bench, scene=DetectGrasps.Request.SCENE_FRESH, timeout=duration(1.5)
    ).report
    assert report.code == code and sentence in report.message


def test_a_camera_that_falls_silent_leaves_stale_depth(bench, wait_until):
    bench.allow_age(1.0)
    bench.camera.sends = {"info"}
    wait_until(lambda: ask(bench).report.code == DetectionReport.STALE_DEPTH)
    assert "s old, max_depth_age is 1.0 s" in ask(bench).report.message


def test_stamps_that_jump_back_do_not_stop_the_camera(bench, wait_until):
    bench.camera.age = back = 24.0  # [s], less than it may be old
    bench.show(RIGHT)
    wait_until(
        lambda: len(p := positions(ask(bench))) and (p[:, 1] < 0).all(),
        seconds=back / 2,
    )


def test_millimetres_find_what_metres_find(bench):
    bench.show(LEFT, RIGHT)
    fresh = DetectGrasps.Request.SCENE_FRESH
    metres = ask(bench, scene=fresh)
    bench.camera.encoding = "16UC1"
    millimetres = ask(bench, scene=fresh)
    assert millimetres.success
    for here in positions(metres):
        assert np.linalg.norm(positions(millimetres) - here, axis=1).min() < 0.01


def test_nothing_good_enough_and_nothing_reachable_say_so(bench):
    bench.show(RIGHT)
    fresh = DetectGrasps.Request.SCENE_FRESH
    report = ask(bench, scene=fresh, min_quality=1.0).report
    assert report.code == DetectionReport.NONE_ABOVE_QUALITY
    assert "asked for 1.00" in report.message and report.sampled > 0
    report = ask(bench, arms=["arm_left_torso"]).report
    assert report.code == DetectionReport.NONE_REACHABLE
    assert "no_ik" in report.message and report.after_quality > 0
    assert report.suggested_base.header.frame_id == "base_footprint"
    assert report.suggested_base.pose.position.y == -0.5


def test_reachability_first_off_and_last(bench):
    bench.show(LEFT, RIGHT)
    fresh, left = DetectGrasps.Request.SCENE_FRESH, ["arm_left_torso"]
    first = ask(bench, scene=fresh, arms=left, reachability=2)
    last = ask(bench, arms=left)
    off = ask(bench, arms=left, reachability=0)
    assert (positions(first)[:, 1] > 0).all() and (positions(last)[:, 1] > 0).all()
    assert first.report.after_reachability >= last.report.after_reachability
    assert (positions(off)[:, 1] < 0).any()
    assert off.grasps.stage == GraspArray.STAGE_SCORED


def test_another_answer_frame_needs_its_transform(bench):
    bench.show(LEFT)
    report = ask(bench, frame_id="map").report
    assert report.code == DetectionReport.TF_ERROR and not report.sampled
    assert report.message == (
        "unknown frame 'map' in frame_id; known: base_footprint, camera_optical"
    )
    there = ask(bench, frame_id="camera_optical")
    assert there.success and there.grasps.header.frame_id == "camera_optical"


def test_a_mask_restricts_the_grasps_to_what_it_covers(bench):
    bench.show(LEFT, RIGHT)
    fresh = DetectGrasps.Request.SCENE_FRESH
    for box, sign in ((LEFT, 1), (RIGHT, -1)):
        answer = ask(bench, scene=fresh, mask=mask_of(box))
        assert answer.success and (sign * positions(answer)[:, 1] > 0).all()
        assert answer.report.after_filters <= answer.report.sampled
    nothing = ask(bench, scene=fresh, mask=mask_of((0.25, 0.15, 0.07))).report
    assert nothing.code == DetectionReport.EMPTY_WORKSPACE
    small = mask_of(LEFT)
    small.width //= 2
    refused = ask(bench, mask=small).report
    assert refused.code == DetectionReport.INVALID_REQUEST
    assert "mask is 80x120, but depth/camera_info says 160x120" in refused.message


def test_answers_say_where_the_pads_will_touch(bench):
    bench.show(LEFT)
    answer = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH)
    assert answer.success
    for grasp in answer.grasps.grasps:
        first, second = ([p.x, p.y, p.z] for p in grasp.contacts)
        apart = np.linalg.norm(np.subtract(first, second))
        assert apart == pytest.approx(grasp.width, abs=1e-6)
        where = [getattr(grasp.pose.position, axis) for axis in "xyz"]
        np.testing.assert_allclose(np.add(first, second) / 2, where, atol=1e-6)
