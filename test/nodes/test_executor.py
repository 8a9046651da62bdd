# SPDX-License-Identifier: Apache-2.0
import gc
import threading
import time

import pytest

pytest.importorskip("rclpy")

from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: E402
from rclpy.node import Node  # noqa: E402

from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.runtime import SpinThread  # noqa: E402

pytestmark = pytest.mark.ros


class Busy(Node):
    """Begins a callback that takes its time, every ten milliseconds."""

    def __init__(self, seconds: float) -> None:
        super().__init__("busy")
        self.seconds = seconds
        self.begun = self.ended = 0
        self.running = threading.Event()
        self.create_timer(0.01, self._work, callback_group=ReentrantCallbackGroup())

    def _work(self) -> None:
        self.begun += 1
        self.running.set()
        time.sleep(self.seconds)
        self.ended += 1


def busy_executor(seconds: float) -> tuple[Busy, PatientExecutor]:
    node, executor = Busy(seconds), PatientExecutor(3)
    executor.add_node(node)
    return node, executor


def test_callbacks_that_run_end_before_the_executor_does(ros, capfd):
    for _ in range(3):
        node, executor = busy_executor(0.1)
        spinning = SpinThread(executor)
        assert node.running.wait(20.0)
        spinning.stop()
        assert node.begun == node.ended > 0
        node.destroy_node()
        gc.collect()  # a task that failed says so when it goes
    assert "never retrieved" not in capfd.readouterr().err


def test_a_callback_that_never_ends_is_not_waited_for_longer(ros):
    node, executor = busy_executor(4.0)
    while not node.running.is_set():
        executor.spin_once(timeout_sec=0.1)
    start = time.monotonic()
    assert not executor.drain(0.1)
    assert time.monotonic() - start < 3.5
    assert executor.shutdown(30.0)
    assert node.begun == node.ended
    node.destroy_node()
