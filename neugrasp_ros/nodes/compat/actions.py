# SPDX-License-Identifier: Apache-2.0
"""An action client whose requests may be sent from any thread.

Up to Jazzy, ``rclpy.action.ActionClient`` sends a request first and notes its number
afterwards. An answer that another thread of the executor takes in between is dropped as
unexpected, and whoever waits for it waits forever.
"""

import threading
from typing import Any

from rclpy import action
from rclpy.task import Future


class ActionClient(action.ActionClient):
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
