# SPDX-License-Identifier: Apache-2.0
"""How much of their limits the set points of drives used, sample by sample."""

from typing import NamedTuple

import numpy as np

from sim_bridge.joint_drive import DriveLimits, Setpoint


class LimitUse(NamedTuple):
    """The most that any set point used of a limit; 1 = all of it.

    Attributes:
        position: How far beyond a position limit in [rad] or [m]; 0 = never.
        velocity: Share of the speed limit.
        acceleration: Share of the acceleration limit.
        jerk: Share of the jerk limit.
        samples: Set points that were looked at.
    """

    position: float = 0.0
    velocity: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    samples: int = 0

    def including(self, point: Setpoint, limits: DriveLimits) -> "LimitUse":
        """Return the same with one more set point."""
        beyond = np.maximum(
            limits.lower - point.position, point.position - limits.upper
        )
        return LimitUse(
            max(self.position, float(beyond.max())),
            max(self.velocity, _share(point.velocity, limits.velocity)),
            max(self.acceleration, _share(point.acceleration, limits.acceleration)),
            max(self.jerk, _share(point.jerk, limits.jerk)),
            self.samples + 1,
        )


def _share(values: np.ndarray, limits: np.ndarray) -> float:
    return float((np.abs(values) / limits).max())
