# SPDX-License-Identifier: Apache-2.0
"""The stage nodes on their own, asked over their services, beside a composed suite."""

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from geometry_msgs.msg import Vector3  # noqa: E402
from neugrasp_msgs.msg import (  # noqa: E402
    DetectionReport,
    Grasp,
    GraspArray,
    GraspCandidates,
)
from neugrasp_msgs.srv import (  # noqa: E402
    CheckReachability,
    DetectGrasps,
    EvaluateGrasps,
    GetTsdf,
    ListAffordances,
    SampleGrasps,
)
from nodes.bench import duration, mask_of, result  # noqa: E402
from nodes.separate_bench import SeparateBench  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from neugrasp_ros.nodes.conversions import from_grasp_array, from_tsdf  # noqa: E402
from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.grasp_server import THREADS, GraspServerNode  # noqa: E402
from neugrasp_ros.nodes.runtime import SpinThread  # noqa: E402

pytestmark = pytest.mark.ros

FRESH = DetectGrasps.Request.SCENE_FRESH
LEFT, RIGHT = (0.15, 0.22, 0.07), (0.15, 0.08, 0.07)


@pytest.fixture(scope="module")
def bench(ros):
    bench = SeparateBench()
    bench.start_separate()
    bench.start_composed()
    yield bench
    bench.stop()


@pytest.fixture(autouse=True)
def usual(bench, wait_until):
    """Begin each test with both boxes seen by both suites."""
    show(bench, LEFT, RIGHT)
    for user in (bench.user, bench.other):
        wait_until(lambda u=user: u.ask(scene=FRESH).success, seconds=60.0)


def show(bench, *boxes) -> None:
    bench.camera.scene.clear()
    for box in boxes:
        bench.camera.scene.add_box(box)


def test_separate_and_composed_give_the_same_grasps_and_scores(bench):
    separate = bench.user.ask(scene=FRESH, seed=5)
    composed = bench.other.ask(scene=FRESH, seed=5)
    assert separate.success and composed.success
    a, b = from_grasp_array(separate.grasps), from_grasp_array(composed.grasps)
    a, b = (g.take(np.argsort(g.grasps.ids)) for g in (a, b))  # ties may swap
    assert a.grasps.ids == b.grasps.ids and len(a) > 1
    np.testing.assert_allclose(a.grasps.quality, b.grasps.quality, atol=1e-4)
    np.testing.assert_allclose(a.grasps.poses, b.grasps.poses, atol=1e-6)
    assert a.reach.arms == b.reach.arms and a.info.labels == b.info.labels
    for report in (separate.report, composed.report):
        assert report.sampled and report.after_reachability == len(a)
        assert report.seconds_quality > 0 and report.seconds_fusion > 0


@pytest.fixture
def few(bench):
    """Yield a client of a server with as many threads as it has as a process."""
    executor = PatientExecutor(THREADS)
    names = ["__node:=few", "detect_grasps:=few/detect_grasps"]
    server = GraspServerNode(cli_args=["--ros-args", "-r", names[0], "-r", names[1]])
    executor.add_node(server)
    spinning = SpinThread(executor)
    client = bench.user.create_client(DetectGrasps, names[1].split("=")[1])
    assert client.wait_for_service(timeout_sec=30.0)
    yield client
    spinning.stop()
    server.destroy_node()


def test_many_requests_at_once_leave_a_thread_for_the_stages_replies(few):
    timeout = duration(20.0)
    futures = [
        few.call_async(DetectGrasps.Request(seed=5, timeout=timeout))
        for _ in range(THREADS)
    ]
    answers = [result(future, 60.0) for future in futures]
    refused = [a.report for a in answers if not a.success]
    assert len(refused) <= 2
    for report in refused:
        assert report.code == DetectionReport.TIMEOUT
        assert report.message.startswith("busy: 3 requests wait")


def test_masks_and_unknown_names_are_treated_alike_in_both(bench):
    show(bench, LEFT, RIGHT)
    for user in (bench.user, bench.other):
        left = user.ask(scene=FRESH, mask=mask_of(LEFT))
        assert left.success and len(left.grasps.grasps)
        assert all(g.pose.position.y > 0 for g in left.grasps.grasps)
        assert all(len(g.contacts) == 2 for g in left.grasps.grasps)
        arm = user.ask(arms=["arm_left_torso", "tail"]).report
        assert arm.code == DetectionReport.INVALID_REQUEST and not arm.views
        assert arm.message == (
            "unknown arm 'tail'; known: arm_left_torso, arm_right_torso"
        )
        frame = user.ask(frame_id="attic").report
        assert frame.code == DetectionReport.TF_ERROR and not frame.views
        assert frame.message.startswith("unknown frame 'attic' in frame_id; known: ba")


def test_affordances_are_queried_alike_in_both(bench):
    for user in (bench.user, bench.other):
        good = user.ask(affordance="pour", scene=FRESH)
        assert good.success and good.grasps.affordance_query == "pour"
        assert good.grasps.grasps[0].affordance == pytest.approx(0.9)
        assert list(good.grasps.grasps[0].affordance_scores) == pytest.approx(
            [0.9, 0.1]
        )
        both = user.ask(affordance="pour&lift").report
        assert both.code == DetectionReport.NONE_WITH_AFFORDANCE
        assert user.ask(affordance="lift|pour").success
        unknown = user.ask(affordance="fly").report
        assert unknown.code == DetectionReport.UNKNOWN_AFFORDANCE
        assert "known: lift, pour" in unknown.message


def test_a_listener_hears_of_a_change_without_any_call(bench, wait_until):
    def sides(user) -> set[bool]:
        heard = user.heard["grasps"]
        return {g.pose.position.y > 0 for g in heard[-1].grasps} if heard else set()

    for boxes, expected in (((LEFT,), {True}), ((RIGHT,), {False})):
        show(bench, *boxes)
        for user in (bench.user, bench.other):
            wait_until(lambda u=user, e=expected: sides(u) == e, seconds=3.0)
    poses = bench.user.heard["grasps/poses"][-1]
    assert len(poses.poses) == len(bench.user.heard["grasps"][-1].grasps)


def candidates(bench, **fields) -> GraspArray:
    answer = bench.call(SampleGrasps, "scene_renderer/sample", seed=3, **fields)
    assert answer.success, answer.message
    return answer.candidates.candidates


def test_the_volume_can_be_had_cleared_and_stopped(bench, wait_until):
    show(bench, LEFT)
    bench.user.ask(scene=FRESH)
    answer = bench.call(GetTsdf, "tsdf_fusion/get_tsdf")
    assert answer.success and answer.volume.header.frame_id == "base_footprint"
    view = from_tsdf(answer.volume)
    assert view.volume.distances.shape == (64, 64, 64)
    assert bench.call(SetBool, "tsdf_fusion/set_integrating", data=False).success
    assert bench.call(Trigger, "tsdf_fusion/reset").success
    empty = bench.call(GetTsdf, "tsdf_fusion/get_tsdf")
    assert not empty.success and empty.message.startswith("NO_DEPTH: ")
    assert bench.call(SetBool, "tsdf_fusion/set_integrating", data=True).success
    wait_until(lambda: bench.call(GetTsdf, "tsdf_fusion/get_tsdf").success)


def test_a_scene_can_be_reset_by_the_request(bench):
    show(bench, LEFT)
    answer = bench.user.ask(scene=DetectGrasps.Request.SCENE_RESET)
    assert answer.success and answer.report.views == 1


def test_sampled_candidates_have_no_score_and_can_be_scored_and_checked(bench):
    show(bench, LEFT, RIGHT)
    bench.user.ask(scene=FRESH)
    array = candidates(bench)
    assert array.stage == GraspArray.STAGE_CANDIDATES and array.scene_revision > 0
    assert np.isnan([g.quality for g in array.grasps]).all()
    scored = bench.call(
        EvaluateGrasps,
        "grasp_evaluator/evaluate",
        candidates=GraspCandidates(candidates=array),
    )
    assert scored.success
    qualities = [g.quality for g in scored.grasps.grasps]
    assert qualities == sorted(qualities, reverse=True)
    assert {g.id for g in scored.grasps.grasps} == {g.id for g in array.grasps}
    checked = bench.call(
        CheckReachability, "reachability_filter/check", grasps=scored.grasps
    )
    assert checked.success and [g.id for g in checked.grasps.grasps] == [
        g.id for g in scored.grasps.grasps
    ]
    assert all(g.reachability == Grasp.REACH_OK for g in checked.grasps.grasps)
    one_arm = bench.call(
        CheckReachability,
        "reachability_filter/check",
        grasps=scored.grasps,
        arms=["arm_left_torso"],
    )
    codes = {g.reachability for g in one_arm.grasps.grasps}
    assert codes == {Grasp.REACH_OK, Grasp.REACH_NO_IK}


def test_the_hand_is_that_of_the_best_grasp_where_reach_comes_first(bench):
    show(bench, RIGHT, LEFT)
    for user in (bench.user, bench.other):
        first = DetectGrasps.Request.REACH_FIRST
        array = user.ask(scene=FRESH, reachability=first).grasps
        side = array.grasps[0].arm.split("_")[1]
        assert array.tcp_frame == f"gripper_{side}_tcp"
        assert array.stage == GraspArray.STAGE_REACHABLE


def test_where_the_base_would_have_to_stand_comes_from_the_other_process(bench):
    show(bench, RIGHT)
    report = bench.user.ask(scene=FRESH, arms=["arm_left_torso"]).report
    assert report.code == DetectionReport.NONE_REACHABLE
    assert report.suggested_base.header.frame_id == "base_footprint"
    assert report.suggested_base.pose.position.y == -0.5


def test_a_question_without_candidates_has_an_answer_without_grasps(bench):
    show(bench, LEFT)
    bench.user.ask(scene=FRESH)
    about = GraspArray(scene_revision=candidates(bench).scene_revision)
    about.header.frame_id = "base_footprint"
    answer = bench.call(
        EvaluateGrasps,
        "grasp_evaluator/evaluate",
        candidates=GraspCandidates(candidates=about),
    )
    assert answer.success and not answer.grasps.grasps
    assert answer.grasps.scene_revision == about.scene_revision


def test_foreign_grasps_in_other_axes_are_scored_where_they_are(bench):
    show(bench, LEFT)
    bench.user.ask(scene=FRESH)
    ours = candidates(bench)
    foreign = GraspArray(axes=GraspArray.AXES_Z_APPROACH_Y_CLOSING)
    foreign.header.frame_id = "base_footprint"
    from neugrasp_ros.nodes.conversions import to_poses

    poses = to_poses(from_grasp_array(ours).grasps.poses)
    foreign.grasps = [Grasp(pose=pose, width=0.05) for pose in poses]
    request = GraspCandidates(candidates=foreign)
    scored = bench.call(EvaluateGrasps, "grasp_evaluator/evaluate", candidates=request)
    known = bench.call(
        EvaluateGrasps,
        "grasp_evaluator/evaluate",
        candidates=GraspCandidates(candidates=ours),
    )
    assert scored.success and scored.grasps.axes == foreign.axes
    np.testing.assert_allclose(
        [g.quality for g in scored.grasps.grasps],
        [g.quality for g in known.grasps.grasps],
        atol=1e-4,
    )


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda a: setattr(a, "scene_revision", 5), "of scene revision 5, at hand: "),
        (lambda a: setattr(a.header, "frame_id", "map"), "grasps are in 'map'"),
        (lambda a: setattr(a.grasps[0], "width", float("nan")), "width is negative"),
        (lambda a: setattr(a, "axes", 7), "axes must be 0, 1 or 2"),
    ],
)
def test_candidates_that_cannot_be_scored_are_refused(bench, change, sentence):
    show(bench, LEFT)
    bench.user.ask(scene=FRESH)
    array = candidates(bench)
    change(array)
    answer = bench.call(
        EvaluateGrasps,
        "grasp_evaluator/evaluate",
        candidates=GraspCandidates(candidates=array),
    )
    assert not answer.success and sentence in answer.message


def test_a_revision_that_never_comes_and_a_bad_region_are_refused(bench):
    answer = bench.call(SampleGrasps, "scene_renderer/sample", roi_size=Vector3(x=-1.0))
    assert not answer.success and "roi_size must be positive" in answer.message
    answer = bench.call(SampleGrasps, "scene_renderer/sample", min_revision=2**62)
    assert not answer.success and "has not come" in answer.message


def test_the_vocabulary_is_listed_with_a_sentence_each(bench):
    for name in ("list_affordances", "grasp_evaluator/list_affordances"):
        answer = bench.call(ListAffordances, name)
        assert answer.labels == ["pour", "lift"]
        assert all(len(text) > 10 for text in answer.descriptions)
