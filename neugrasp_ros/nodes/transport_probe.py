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
    return figures(before, after, elapsed)


def figures(
    before: dict[str, float], after: dict[str, float], elapsed: float
) -> dict[str, Any]:
    """Return rates and shares from what both nodes counted before and after.

    The two nodes report at different moments, so what was published by the stamp of
    the newest image received is interpolated; that is right to one image.

    Args:
        before: What ``_read`` gave at the start.
        after: And at the end.
        elapsed: Wall time between them in [s].
    """
    published = after["published"] - before["published"]
    rate = published / max(after["published_stamp"] - before["published_stamp"], 1e-9)

    def published_by(reading: dict[str, float]) -> float:
        ahead = reading["received_stamp"] - reading["published_stamp"]
        return reading["published"] + ahead * rate

    received = after["received"] - before["received"]
    sent = published_by(after) - published_by(before)
    simulated = after["simulated"] - before["simulated"]
    return {
        "seconds": round(elapsed, 2),
        "published": int(published),
        "received": int(received),
        "published_hz": round(published / elapsed, 3),
        "received_share": round(received / max(round(sent), 1), 4),
        "real_time_factor": round(simulated / elapsed, 3),
        "image": "640x480 32FC1",
    }


def _read(counter: Counter) -> dict[str, float]:
    return {
        "published": counter.number(CAMERA, "published"),
        "published_stamp": counter.number(CAMERA, "newest_stamp"),
        "received_stamp": counter.number(DEPTH, "newest_stamp"),
        "received": counter.number(DEPTH, "received"),
        "simulated": counter.number(PHYSICS, "simulated_seconds"),
    }
