# SPDX-License-Identifier: Apache-2.0
"""Joint trajectories between messages and arrays."""

from typing import NamedTuple

import numpy as np
from builtin_interfaces.msg import Duration
from numpy.typing import NDArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from neugrasp_ros.errors import ConfigError

FloatArray = NDArray[np.float64]

NANOSECONDS = 10**9


class Points(NamedTuple):
    """Points of a trajectory; what a message leaves out is None.

    Attributes:
        times: Seconds from the start, shape (T,).
        positions: In [rad] or [m], shape (T, n).
        velocities: Shape (T, n).
        accelerations: Shape (T, n).
    """

    times: FloatArray
    positions: FloatArray
    velocities: FloatArray | None
    accelerations: FloatArray | None


def to_duration(seconds: float) -> Duration:
    """Return seconds as a message."""
    sec, nanosec = divmod(round(seconds * NANOSECONDS), NANOSECONDS)
    return Duration(sec=int(sec), nanosec=int(nanosec))


def to_seconds(duration: Duration) -> float:
    """Return a duration message in [s]."""
    return float(duration.sec + duration.nanosec / NANOSECONDS)


def to_joint_trajectory(names: tuple[str, ...], points: Points) -> JointTrajectory:
    """Return points as a message that starts when it arrives."""
    zeros = np.zeros_like(points.positions)
    velocities = zeros if points.velocities is None else points.velocities
    accelerations = zeros if points.accelerations is None else points.accelerations
    return JointTrajectory(
        joint_names=list(names),
        points=[
            JointTrajectoryPoint(
                positions=p,
                velocities=v,
                accelerations=a,
                time_from_start=to_duration(t),
            )
            for t, p, v, a in zip(
                points.times,
                points.positions.tolist(),
                velocities.tolist(),
                accelerations.tolist(),
                strict=True,
            )
        ],
    )


def from_joint_trajectory(message: JointTrajectory, names: tuple[str, ...]) -> Points:
    """Read a message for a controller's joints.

    Args:
        message: The trajectory, its joints in any order.
        names: The joints of the controller.

    Raises:
        ConfigError: If it holds other joints, no points, points of a wrong length, or
            numbers that are not finite.
    """
    if sorted(message.joint_names) != sorted(names):
        raise ConfigError(
            f"expected the joints {list(names)}, got {list(message.joint_names)}"
        )
    if not message.points:
        raise ConfigError("the trajectory has no points")
    order = [message.joint_names.index(name) for name in names]
    times = np.array([to_seconds(p.time_from_start) for p in message.points])

    def column(field: str) -> FloatArray | None:
        rows = [getattr(point, field) for point in message.points]
        if field != "positions" and not any(len(row) for row in rows):
            return None
        if any(len(row) != len(names) for row in rows):
            raise ConfigError(f"{field}: expected {len(names)} numbers in every point")
        values = np.array(rows, dtype=np.float64)[:, order]
        if not np.isfinite(values).all():  # NaN is beyond no limit, so none finds it
            raise ConfigError(f"{field}: expected finite numbers in every point")
        return values

    positions = column("positions")
    assert positions is not None
    return Points(times, positions, column("velocities"), column("accelerations"))
