# SPDX-License-Identifier: Apache-2.0
"""A process whose threads and timers publish all the time, run by ``runtime.run``."""

import sys
import threading
from collections.abc import Callable

from rclpy.executors import Executor
from rclpy.node import Node
from std_msgs.msg import String

from neugrasp_ros.nodes.runtime import run


class Talker(Node):
    """Publishes from a thread and from a timer until it is destroyed."""

    def __init__(self) -> None:
        super().__init__("talker")
        self.output = self.create_publisher(String, "talk", 1)
        self.closed = threading.Event()
        self.is_new = True
        self.create_timer(0.002, self.tick)
        self.thread = threading.Thread(target=self.talk, daemon=True)
        self.thread.start()

    def tick(self) -> None:
        self.output.publish(String())
        if self.is_new:
            sys.stdout.write("talking\n")
            sys.stdout.flush()
        self.is_new = False

    def talk(self) -> None:
        while not self.closed.wait(0.0005):
            self.output.publish(String())

    def destroy_node(self) -> None:
        self.closed.set()
        self.thread.join()
        super().destroy_node()


def start(executor: Executor) -> Callable[[], None]:
    node = Talker()
    executor.add_node(node)
    return node.destroy_node


if __name__ == "__main__":
    sys.exit(run("talker", start, sys.argv[1:]))
