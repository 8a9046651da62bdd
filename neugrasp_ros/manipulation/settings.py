# SPDX-License-Identifier: Apache-2.0
"""How the robot moves and what it does with what it holds, as checked options."""

from dataclasses import dataclass

from neugrasp_ros.config import Checked, option

Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class MoverConfig(Checked):
    """Motion of an arm with its torso."""

    speed: float = option(
        0.8, "Share of the joints' velocity, acceleration and jerk used", 0.05, 1.0
    )
    clearance: float = option(
        0.012, "Distance kept by all links on the way through free space [m]", 0.0, 0.1
    )
    timeout: float = option(6.0, "Longest search for a way [s]", 0.05, 30.0)
    drop_time: float = option(
        18.0,
        "Longest search for a way to a box, all postures there [s]",
        0.1,
        120.0,
    )
    shortcut_time: float = option(0.1, "Time to shorten a way [s]", 0.0, 5.0)
    check_step: float = option(
        0.02, "Largest change of a joint between checked postures [rad]", 0.005, 0.1
    )
    held_radius: float = option(
        0.12, "Seen points this near to a grasp leave with the object [m]", 0.0, 0.3
    )
    sample_step: float = option(
        0.02, "Spacing of a trajectory's points [s]", 0.002, 0.1
    )


@dataclass(frozen=True, kw_only=True)
class ExecutorConfig(Checked):
    """What the robot does with a grasp."""

    empty_opening: float = option(
        0.002, "Jaws that close further hold nothing [m]", 0.0, 0.05
    )
    back_out: float = option(
        0.10, "Way out of a place that is too narrow [m]", 0.0, 0.5
    )
    drop_left: Triple = option(
        (0.34, 0.62, 0.80), "Where the left hand lets go, in the base frame [m]"
    )
    drop_right: Triple = option(
        (0.34, -0.62, 0.80), "Where the right hand lets go, in the base frame [m]"
    )

    def drop_point(self, arm: str) -> Triple:
        """Return where an arm lets go in [m]; arms without a side use the left's."""
        return self.drop_right if "right" in arm else self.drop_left
