# SPDX-License-Identifier: Apache-2.0
"""An action client whose requests may be sent from any thread.

Before rclpy 7.1.6, ``rclpy.action.ActionClient`` sends a request first and notes its
number afterwards (ros2/rclpy#1123). An answer that another thread of the executor takes
in between is dropped as unexpected, and whoever waits for it waits forever.
"""

import inspect
import threading
from typing import Any

from rclpy import action
from rclpy.task import Future


class PatientClient(action.ActionClient):
    """The client of rclpy, which takes no answer while it sends a request."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._sending = threading.RLock()
        super().__init__(*arguments, **options)

    def send_goal_async(self, *arguments: Any, **options: Any) -> Future:
        """Send a goal, see rclpy."""
        with self._sending:
            return super().send_goal_async(*arguments, **options)

    def _cancel_goal_async(self, goal_handle: Any) -> Future:
        with self._sending:
            return super()._cancel_goal_async(goal_handle)

    def _get_result_async(self, goal_handle: Any) -> Future:
        with self._sending:
            return super()._get_result_async(goal_handle)

    def take_data(self) -> Any:
        """Take what has come, see rclpy."""
        with self._sending:
            return super().take_data()


def sends_under_lock(client: Any) -> bool:
    """Tell whether a client of rclpy itself notes a request's number in time."""
    return "_lock" in inspect.getsource(client.send_goal_async)


ActionClient = (
    action.ActionClient if sends_under_lock(action.ActionClient) else PatientClient
)
