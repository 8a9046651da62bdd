# SPDX-License-Identifier: Apache-2.0
"""Requests that meet each other, take long, are cancelled, or hit a bug."""

import threading
import time
from contextlib import contextmanager

import pytest

pytest.importorskip("neugrasp_msgs")

from action_msgs.msg import GoalStatus  # noqa: E402
from neugrasp_msgs.action import DetectGrasps as DetectAction  # noqa: E402
from neugrasp_msgs.msg import DetectionReport  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from nodes.bench import LEFT, RIGHT, ask, duration, result  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

pytestmark = pytest.mark.ros


@pytest.fixture(autouse=True)
def ready(bench, wait_until):
    wait_until(lambda: ask(bench).success, 30.0)


def test_two_clients_at_once_are_answered_one_after_the_other(bench, monkeypatch):
    stages, running, most = bench.suite.stages, [], []
    usual = stages.request

    @contextmanager
    def counted():
        running.append(1)
        most.append(len(running))
        with usual():
            yield
        running.pop()

    monkeypatch.setattr(stages, "request", counted)
    bench.show(LEFT, RIGHT)
    futures = [
        node.client.call_async(DetectGrasps.Request(seed=1))
        for node in (bench.user, bench.other, bench.user, bench.other)
        if node.client.wait_for_service(timeout_sec=10.0)
    ]
    answers = [result(future) for future in futures]
    assert len(answers) == 4 and all(answer.success for answer in answers)
    assert most == [1] * 4


class Slow:
    """Makes scoring take a while, until told otherwise."""

    def __init__(self, planner) -> None:
        self.planner, self.usual = planner, planner.evaluate
        self.go = threading.Event()
        planner.evaluate = self.evaluate

    def evaluate(self, *args, **kwargs):
        self.go.wait(10.0)
        return self.usual(*args, **kwargs)

    def stop(self) -> None:
        self.go.set()
        self.planner.evaluate = self.usual


@pytest.fixture
def slow(bench):
    slow = Slow(bench.suite._make_planner._made[1].planner)
    yield slow
    slow.stop()


@pytest.fixture
def action(bench):
    assert bench.action.wait_for_server(timeout_sec=10.0)
    return bench.action


def test_the_action_gives_feedback_and_the_services_answer(
    bench, action, monkeypatch, wait_until
):
    bench.show(LEFT, RIGHT)
    fresh = DetectGrasps.Request.SCENE_FRESH
    answer = ask(bench, scene=fresh)
    heard = []
    stages = bench.suite.stages
    usual = stages.check

    def check_once_heard(*args, **kwargs):  # rclpy drops feedback after the result
        wait_until(lambda: heard and heard[-1].stage == "reachability")
        return usual(*args, **kwargs)

    monkeypatch.setattr(stages, "check", check_once_heard)
    goal = result(
        action.send_goal_async(
            DetectAction.Goal(seed=1), lambda m: heard.append(m.feedback)
        )
    )
    outcome = result(goal.get_result_async())
    assert outcome.status == GoalStatus.STATUS_SUCCEEDED
    assert [g.pose for g in outcome.result.grasps.grasps] == [
        g.pose for g in answer.grasps.grasps
    ]
    told = [f.stage for f in heard]
    assert "fusion" in told
    assert heard[told.index("reachability")].grasps_so_far > 0
    assert [f.progress for f in heard] == sorted(f.progress for f in heard)


def test_a_goal_can_be_canceled_and_a_second_one_is_rejected(bench, action, slow):
    bench.show(LEFT, RIGHT)
    goal = result(action.send_goal_async(DetectAction.Goal(seed=1)))
    assert goal.accepted
    second = result(action.send_goal_async(DetectAction.Goal()))
    assert not second.accepted
    result(goal.cancel_goal_async())
    slow.go.set()
    outcome = result(goal.get_result_async())
    assert outcome.status == GoalStatus.STATUS_CANCELED
    assert outcome.result.report.code == DetectionReport.CANCELED


@pytest.fixture
def silent(bench):
    """Let the camera take no images meanwhile."""
    bench.camera.sends = {"info"}
    yield
    bench.camera.sends = {"depth", "info"}


def canceled(goal) -> DetectionReport:
    """Cancel a goal that waits and return its report."""
    start = time.monotonic()
    result(goal.cancel_goal_async())
    outcome = result(goal.get_result_async())
    assert time.monotonic() - start < 2.0, "0.2 s are promised; the machine is busy"
    assert outcome.status == GoalStatus.STATUS_CANCELED
    return outcome.result.report


@pytest.mark.parametrize(
    "fields", [{"scene": DetectGrasps.Request.SCENE_FRESH}, {"min_views": 5}]
)
def test_a_goal_that_waits_for_an_image_can_be_canceled(
    action, silent, wait_until, fields
):
    heard = []
    goal = result(
        action.send_goal_async(
            DetectAction.Goal(**fields), lambda m: heard.append(m.feedback.stage)
        )
    )
    wait_until(lambda: "fusion" in heard)
    assert canceled(goal).code == DetectionReport.CANCELED


@pytest.fixture
def server(bench):
    server = bench.suite.nodes[1]
    yield server
    server.set_parameters([Parameter("goal_policy", value="reject")])


def test_a_client_that_waits_in_vain_for_its_turn_is_told(
    bench, slow, server, wait_until
):
    first = bench.user.client.call_async(DetectGrasps.Request(seed=1))
    wait_until(server._turn.locked)
    report = ask(bench, timeout=duration(0.3)).report
    assert report.code == DetectionReport.TIMEOUT
    assert report.message == "another request ran for 0.3 s"
    slow.go.set()
    assert result(first).success


def test_a_goal_that_waits_for_its_turn_can_be_canceled(
    bench, action, slow, server, wait_until
):
    server.set_parameters([Parameter("goal_policy", value="queue")])
    first = bench.user.client.call_async(DetectGrasps.Request(seed=1))
    wait_until(server._turn.locked)
    report = canceled(result(action.send_goal_async(DetectAction.Goal())))
    assert report.code == DetectionReport.CANCELED
    assert report.message == "canceled before its turn came"
    slow.go.set()
    assert result(first).success


def test_a_goal_may_preempt_the_one_that_runs(bench, action, slow, server, wait_until):
    server.set_parameters([Parameter("goal_policy", value="preempt")])
    first = result(action.send_goal_async(DetectAction.Goal(seed=1)))
    wait_until(server._turn.locked)
    second = result(action.send_goal_async(DetectAction.Goal(seed=1)))
    assert first.accepted and second.accepted
    slow.go.set()
    outcome = result(first.get_result_async())
    assert outcome.status == GoalStatus.STATUS_ABORTED
    assert outcome.result.report.code == DetectionReport.CANCELED
    outcome = result(second.get_result_async())
    assert outcome.status == GoalStatus.STATUS_SUCCEEDED


def test_a_request_that_runs_out_of_time_says_so(bench, slow):
    bench.show(LEFT)
    threading.Timer(0.6, slow.go.set).start()
    report = ask(bench, timeout=duration(0.3)).report
    assert report.code == DetectionReport.TIMEOUT


def test_a_bug_is_answered_as_internal_and_the_node_lives_on(bench):
    planner = bench.suite._make_planner._made[1].planner
    usual = planner.sample
    planner.sample = lambda *_, **__: 1 / 0
    bench.show(LEFT)
    try:
        report = ask(bench, scene=DetectGrasps.Request.SCENE_FRESH).report
    finally:
        planner.sample = usual
    assert report.code == DetectionReport.INTERNAL and "grasp_server" in report.message
    assert ask(bench).success
