# SPDX-License-Identifier: Apache-2.0
import asyncio
import threading

import pytest

rclpy = pytest.importorskip("rclpy")

from control_msgs.action import FollowJointTrajectory  # noqa: E402
from rclpy.action.client import ActionClient as PlainClient  # noqa: E402
from rclpy.node import Node  # noqa: E402

from neugrasp_ros.nodes.compat.actions import ActionClient  # noqa: E402

RESPONSE = FollowJointTrajectory.Impl.SendGoalService.Response(accepted=True)


class Overtaken:
    """Stands in for the middleware: the answer is there before the number is noted."""

    def __init__(self, client):
        self.client = client
        self.taker = threading.Thread(target=self.take)

    def take(self):
        self.client._is_goal_response_ready = True
        asyncio.run(self.client.execute(self.client.take_data()))

    def send_goal_request(self, request):
        self.taker.start()
        self.taker.join(0.3)
        return 7

    def take_goal_response(self, kind):
        return 7, RESPONSE


@pytest.mark.parametrize("kind", [ActionClient, PlainClient])
def test_an_answer_that_comes_while_a_goal_is_sent_waits_for_its_number(ros, kind):
    node = Node("sender")
    client = kind(node, FollowJointTrajectory, "motion")
    fast = Overtaken(client)
    flags = ("cancel_response", "result_response", "feedback", "status")
    for flag in flags:
        setattr(client, f"_is_{flag}_ready", False)
    real, client._client_handle = client._client_handle, fast
    try:
        future = client.send_goal_async(FollowJointTrajectory.Goal())
        fast.taker.join()
    finally:
        client._client_handle = real
        client.destroy()
        node.destroy_node()
    mended = kind is ActionClient
    assert future.done() == mended, "rclpy may have mended it: then drop ActionClient"
    assert not mended or future.result().accepted
