# SPDX-License-Identifier: Apache-2.0
import argparse

import pytest

pytest.importorskip("rclpy")

from neugrasp_ros.cli.transport import is_enough, origin  # noqa: E402
from neugrasp_ros.nodes.transport_probe import figures  # noqa: E402

START = {
    "published": 100, "published_stamp": 10.0,
    "received": 98, "received_stamp": 9.9, "simulated": 10.0,
}  # fmt: skip


def end(received: int, **changes) -> dict[str, float]:
    """Ten seconds later at 10 Hz; the fusion reports half a second after the bridge."""
    reading = {
        "published": 200, "published_stamp": 20.0,
        "received": received, "received_stamp": 20.5, "simulated": 20.0,
    }  # fmt: skip
    return reading | changes


def test_all_images_arrived_though_the_nodes_report_at_different_moments():
    found = figures(START, end(98 + 106), 10.0)
    assert found["published_hz"] == 10.0 and found["received"] == 106
    assert found["received_share"] == pytest.approx(1.0)
    assert is_enough(found)


def test_lost_images_count():
    found = figures(START, end(98 + 100), 10.0)
    assert found["received_share"] == pytest.approx(100 / 106, abs=1e-3)
    assert not is_enough(found)


def test_a_slow_simulation_is_not_enough():
    found = figures(START, end(98 + 106, simulated=18.0), 10.0)
    assert found["real_time_factor"] == 0.8 and not is_enough(found)


def test_the_record_says_how_to_repeat_it():
    args = argparse.Namespace(seconds=60.0, seed=3)
    made = origin(args)
    assert made["seed"] == 3 and len(made["weights_sha256"]) == 64
    assert made["command"] == "neugrasp transport --seconds 60 --seed 3"
    assert "commit" in made
