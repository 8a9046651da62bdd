# SPDX-License-Identifier: Apache-2.0
"""What every test session gets: ROS on loopback in a domain of its own, GPU guards."""

import os
import random
import socket
import tempfile

import pytest

DOMAINS = range(1, 101)
LOCK_PORT = 31000  # of domain 0; a bound socket reserves a domain on this machine

# Before anything imports rclpy. A domain that the caller uses is not ours to talk in.
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.pop("ROS_LOCALHOST_ONLY", None)
os.environ.pop("ROS_STATIC_PEERS", None)


def reserve_domain() -> tuple[int, socket.socket]:
    """Return a random domain that no other session uses, and what keeps it ours."""
    for candidate in random.sample(DOMAINS, len(DOMAINS)):
        lock = socket.socket()
        try:
            lock.bind(("127.0.0.1", LOCK_PORT + candidate))
        except OSError:
            lock.close()
            continue
        return candidate, lock
    raise RuntimeError(f"all test domains are taken: {DOMAINS}")


def pytest_configure(config: pytest.Config) -> None:
    domain, lock = reserve_domain()
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    logs = tempfile.TemporaryDirectory(prefix="neugrasp_test_log_")
    os.environ.setdefault("ROS_LOG_DIR", logs.name)
    config.add_cleanup(lock.close)
    config.add_cleanup(logs.cleanup)


def pytest_report_header() -> str:
    return f"ROS domain {os.environ['ROS_DOMAIN_ID']}, this machine only"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    on_gpu = [item for item in items if item.get_closest_marker("gpu")]
    if not on_gpu:
        return
    import torch

    if not torch.cuda.is_available():
        for item in on_gpu:
            item.add_marker(pytest.mark.skip(reason="no CUDA device"))


@pytest.fixture(scope="session")
def domain() -> int:
    return int(os.environ["ROS_DOMAIN_ID"])
