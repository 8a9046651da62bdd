# SPDX-License-Identifier: Apache-2.0
"""Nodes spinning in the background, and waiting on conditions."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest


@pytest.fixture(scope="session")
def ros(domain: int) -> Iterator[None]:
    import rclpy

    from neugrasp_ros.nodes.runtime import prepare

    prepare()
    rclpy.init(args=[])
    yield
    rclpy.try_shutdown()


class Spinner:
    """Nodes spinning in a background thread."""

    def __init__(self) -> None:
        from neugrasp_ros.nodes.executor import PatientExecutor
        from neugrasp_ros.nodes.runtime import SpinThread

        self.executor = PatientExecutor(8)
        self.nodes: list = []
        self._spinning = SpinThread(self.executor)

    def add(self, node):
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def stop(self) -> None:
        self._spinning.stop()
        for node in self.nodes:
            node.destroy_node()


@pytest.fixture
def spinner(ros: None) -> Iterator[Spinner]:
    spinner = Spinner()
    yield spinner
    spinner.stop()


def wait_until(
    condition: Callable[[], object], seconds: float = 10.0, what: str = ""
) -> object:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise AssertionError(f"not within {seconds} s: {what or condition}")


@pytest.fixture(scope="module")
def bench(ros: None) -> Iterator[Any]:
    """Yield a composed suite that is at work, its camera and two users."""
    from nodes.bench import Bench

    bench = Bench()
    bench.start()
    yield bench
    bench.stop()


@pytest.fixture(name="wait_until")
def wait_until_fixture() -> Callable[..., object]:
    return wait_until
