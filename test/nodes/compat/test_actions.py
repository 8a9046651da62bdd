# SPDX-License-Identifier: Apache-2.0
"""The middleware's answer is there before the client has noted the request's number."""

import asyncio
import threading

import pytest

rclpy = pytest.importorskip("rclpy")

from control_msgs.action import FollowJointTrajectory  # noqa: E402
from rclpy.action.client import ClientGoalHandle  # noqa: E402
from rclpy.node import Node  # noqa: E402
from unique_identifier_msgs.msg import UUID  # noqa: E402

from neugrasp_ros.nodes.compat.actions import (  # noqa: E402
    PatientClient,
    sends_under_lock,
)

ACTION = FollowJointTrajectory.Impl
ANSWERS = {
    "goal": ACTION.SendGoalService.Response(accepted=True),
    "cancel": ACTION.CancelGoalService.Response(),
    "result": ACTION.GetResultService.Response(),
}


class Overtaking:
    """Stands in for the middleware's end of a client."""

    def __init__(self, client, kind):
        self.client, self.kind = client, kind
        self.taker = threading.Thread(target=self.take)

    def take(self):
        asyncio.run(self.client.execute(self.client.take_data()))

    def __getattr__(self, name):
        if name.startswith("send_"):
            return self.send
        return lambda *_: (7, ANSWERS[self.kind])

    def send(self, request):
        self.taker.start()
        self.taker.join(0.3)
        return 7


@pytest.fixture
def client(ros):
    node = Node("sender")
    client = PatientClient(node, FollowJointTrajectory, "motion")
    real = client._client_handle
    yield client
    client._client_handle = real
    client.destroy()
    node.destroy_node()


@pytest.mark.parametrize("kind", ANSWERS)
def test_an_answer_that_comes_while_a_request_is_sent_is_not_lost(client, kind):
    for flag in ("goal_response", "cancel_response", "result_response"):
        setattr(client, f"_is_{flag}_ready", flag.startswith(kind))
    client._is_feedback_ready = client._is_status_ready = False
    fast = Overtaking(client, kind)
    client._client_handle = fast
    handle = ClientGoalHandle(client, UUID(), ANSWERS["goal"])
    requests = {
        "goal": lambda: client.send_goal_async(FollowJointTrajectory.Goal()),
        "cancel": handle.cancel_goal_async,
        "result": handle.get_result_async,
    }
    future = requests[kind]()
    fast.taker.join()
    assert future.done()


def test_a_client_that_locks_its_requests_itself_is_known():
    class Locking:
        def send_goal_async(self):
            with self._lock:
                return None

    class Plain:
        def send_goal_async(self):
            return None

    assert sends_under_lock(Locking)
    assert not sends_under_lock(Plain)
