# SPDX-License-Identifier: Apache-2.0
import pytest

from neugrasp_ros.nodes.motion_deadline import STILL_TIME, MotionDeadline

SECOND = 10**9


class Clocks:
    """A node's clock [ns] and a wall clock [s] that are set by hand."""

    def __init__(self) -> None:
        self.time, self.wall = 100 * SECOND, 0.0
        self.deadline = MotionDeadline(5.0, lambda: self.time, lambda: self.wall)

    def run(self, seconds: float, rate: float, period: float = 0.02) -> bool:
        """Let wall time pass, the node's ``rate`` times as fast; tell if it is over."""
        for _ in range(round(seconds / period)):
            self.wall += period
            self.time += int(rate * period * SECOND)
            if self.deadline.is_over():
                return True
        return False


@pytest.mark.parametrize("rate", [0.02, 0.5, 1.0, 4.0])
def test_time_counts_as_the_controllers_live_it(rate):
    clocks = Clocks()
    assert not clocks.run(4.9 / rate, rate)
    assert clocks.run(0.3 / rate, rate)


@pytest.mark.parametrize("jump", [-90, -6, 6, 10**9])
def test_a_clock_that_is_set_neither_ends_a_motion_nor_lets_it_go_on(jump):
    clocks = Clocks()
    assert not clocks.run(1.0, 1.0)
    clocks.time += jump * SECOND
    assert not clocks.run(2.5, 1.0)
    assert clocks.run(2.0, 1.0)


def test_a_clock_that_stands_still_is_waited_for_by_the_wall_clock():
    clocks = Clocks()
    assert not clocks.run(STILL_TIME - 1.0, 0.0)
    assert not clocks.run(1.0, 1.0), "it went on"
    assert not clocks.run(STILL_TIME - 1.0, 0.0)
    assert clocks.run(2.0, 0.0)
