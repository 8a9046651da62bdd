# SPDX-License-Identifier: Apache-2.0
"""``/diagnostics``: what a node counts, once a second."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile

PERIOD = 1.0  # [s]
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Status(NamedTuple):
    """What a part of a node says of itself.

    Attributes:
        level: ``OK``, ``WARN`` or ``ERROR``.
        message: One sentence.
        values: Numbers and words by name.
    """

    level: bytes
    message: str
    values: Mapping[str, object]


class Diagnostics:
    """Publishes the statuses of a node.

    Args:
        node: The node.
        parts: Functions that return the status of a part, by the part's name.
    """

    def __init__(self, node: Node, parts: Mapping[str, Callable[[], Status]]) -> None:
        self._node = node
        self._parts = parts
        self._publisher = node.create_publisher(
            DiagnosticArray, "/diagnostics", QoSProfile(depth=10)
        )
        node.create_timer(
            PERIOD, self.publish, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def publish(self) -> None:
        """Publish all statuses now."""
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        for name, ask in self._parts.items():
            level, message, values = ask()
            status = DiagnosticStatus(
                level=level,
                name=f"{self._node.get_name()}: {name}",
                message=message,
                hardware_id="none",
            )
            status.values = [
                KeyValue(key=key, value=str(value)) for key, value in values.items()
            ]
            array.status.append(status)
        self._publisher.publish(array)
