# SPDX-License-Identifier: Apache-2.0
"""Counts what the bridge publishes and the fusion receives, by their diagnostics."""

import threading
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile

from neugrasp_ros.nodes.client import NoAnswerError, SuiteClient

CAMERA, PHYSICS = "sim_bridge: camera", "sim_bridge: physics"
DEPTH = "tsdf_fusion: depth"


class Counter:
    """The newest diagnostics of a suite.

    Args:
        client: Whose node listens.
    """

    def __init__(self, client: SuiteClient) -> None:
        self._values: dict[str, dict[str, str]] = {}
        self._changed = threading.Condition()
        client.node.create_subscription(
            DiagnosticArray, "/diagnostics", self._take, QoSProfile(depth=20)
        )

    def _take(self, message: DiagnosticArray) -> None:
        with self._changed:
            for status in message.status:
                self._values[status.name] = {v.key: v.value for v in status.values}
            self._changed.notify_all()

    def wait_for_images(self, seconds: float) -> None:
        """Wait until both nodes count images.

        Raises:
            NoAnswerError: If they don't within ``seconds``.
        """

        def counting() -> bool:
            return self.number(CAMERA, "published") > 0 < self.number(DEPTH, "received")

        with self._changed:
            if not self._changed.wait_for(counting, timeout=seconds):
                raise NoAnswerError(f"no images after {seconds} s: {self._values}")

    def number(self, status: str, key: str) -> float:
        """Return a number, 0 while unknown."""
        return float(self._values.get(status, {}).get(key, 0))


def measure(seconds: float, start_timeout: float) -> dict[str, Any]:
    """Count for a while.

    Args:
        seconds: How long.
        start_timeout: How long to wait for the first images [s].

    Returns:
        Rates, shares and counts by name.

    Raises:
        NoAnswerError: If no images come.
    """
    with SuiteClient() as client:
        counter = Counter(client)
        counter.wait_for_images(start_timeout)
        before = _read(counter)
        start = time.monotonic()
        threading.Event().wait(seconds)
        after, elapsed = _read(counter), time.monotonic() - start
    published = after["published"] - before["published"]
    received = after["received"] - before["received"]
    return {
        "seconds": round(elapsed, 2),
        "published": int(published),
        "received": int(received),
        "published_hz": round(published / elapsed, 3),
        "received_share": round(received / max(published, 1), 4),
        "real_time_factor": round(
            (after["simulated"] - before["simulated"]) / elapsed, 3
        ),
        "image": "640x480 32FC1",
    }


def _read(counter: Counter) -> dict[str, float]:
    return {
        "published": counter.number(CAMERA, "published"),
        "received": counter.number(DEPTH, "received"),
        "simulated": counter.number(PHYSICS, "simulated_seconds"),
    }
