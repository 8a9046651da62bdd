# SPDX-License-Identifier: Apache-2.0
"""What a joint trajectory controller does: follow, hold, and stop within limits.

Between the points of a trajectory the set point follows quintic polynomials, so that
position, velocity and acceleration are continuous. A stop slows down the time of the
path, not the joints one by one: the arm stays on the way that was checked.
"""

from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError

FloatArray = NDArray[np.float64]

STOP_TIMES = (0.15, 0.25, 0.4, 0.6, 0.9, 1.4, 2.0)  # [s], the first that holds is taken
STOP_SAMPLES = 240  # of the path time during a stop
PIECE_SHARES = np.linspace(0.002, 0.998, 11)  # where a stop is checked in each piece
STOP_MARGIN = 0.98  # share of the jerk limit that may be used there
POSITION_SLACK = 1e-3  # [rad] or [m]; beyond a limit, of a goal


class DriveLimits(NamedTuple):
    """Bounds of a drive's joints, each of shape (n,), in [rad] or [m]."""

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray


class Setpoint(NamedTuple):
    """Where the joints shall be and how they shall move, each of shape (n,)."""

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray


def _still(position: FloatArray) -> Setpoint:
    """Return the set point of joints at rest."""
    zero = np.zeros(len(position))
    return Setpoint(np.array(position, dtype=np.float64), zero, zero, zero)


class DriveState(Enum):
    """What a drive is doing."""

    HOLDING = "holding"
    FOLLOWING = "following"
    STOPPING = "stopping"


class Track:
    """A trajectory as quintic pieces.

    Args:
        times: Seconds from the start, increasing, the first 0, shape (T,).
        positions: Shape (T, n).
        velocities: Shape (T, n).
        accelerations: Shape (T, n).

    Attributes:
        times: As given.

    Raises:
        ConfigError: If the times do not increase from 0.
    """

    def __init__(
        self,
        times: FloatArray,
        positions: FloatArray,
        velocities: FloatArray,
        accelerations: FloatArray,
    ) -> None:
        if len(times) < 2 or times[0] != 0.0 or not (np.diff(times) > 0).all():
            raise ConfigError(f"times must increase from 0, got {times.tolist()[:5]}")
        self.times = times
        h = np.diff(times)[:, None]
        p0, p1 = positions[:-1], positions[1:]
        v0, v1 = velocities[:-1] * h, velocities[1:] * h
        a0, a1 = accelerations[:-1] * h**2 / 2, accelerations[1:] * h**2 / 2
        d = p1 - p0
        self._coefficients = np.stack(
            [
                p0,
                v0,
                a0,
                10 * d - 6 * v0 - 4 * v1 - 3 * a0 + a1,
                -15 * d + 8 * v0 + 7 * v1 + 3 * a0 - 2 * a1,
                6 * d - 3 * (v0 + v1) - a0 + a1,
            ]
        )  # (6, T - 1, n), of the share of a piece's time

    @property
    def duration(self) -> float:
        """Length in [s]."""
        return float(self.times[-1])

    def at(self, time: float) -> Setpoint:
        """Return the set point at a time in [s]; past the end it stands still."""
        if time >= self.duration:
            return _still(self._piece(len(self.times) - 2, 1.0).position)
        k = int(np.searchsorted(self.times, time, side="right")) - 1
        span = self.times[k + 1] - self.times[k]
        return self._piece(k, (time - self.times[k]) / span)

    def _piece(self, k: int, u: float) -> Setpoint:
        h = float(self.times[k + 1] - self.times[k])
        c = self._coefficients[:, k]
        powers = u ** np.arange(6)
        order = np.arange(6)
        first = order[1:] * powers[:5]
        second = order[2:] * order[1:5] * powers[:4]
        third = order[3:] * order[2:5] * order[1:4] * powers[:3]
        return Setpoint(
            powers @ c, first @ c[1:] / h, second @ c[2:] / h**2, third @ c[3:] / h**3
        )


@dataclass(frozen=True, slots=True)
class _Stop:
    """A stop that began at a time of the path and takes some seconds."""

    begin: float
    path_time: float
    seconds: float

    def at(self, now: float) -> tuple[float, float, float, float]:
        """Return path time, its rate, and that rate's first two derivatives."""
        u = min(max((now - self.begin) / self.seconds, 0.0), 1.0)
        T = self.seconds
        rate = 1 - u**3 * (10 - 15 * u + 6 * u**2)
        gone = u - u**4 * (2.5 - 3 * u + u**2)
        slope = -30 * u**2 * (1 - u) ** 2 / T
        curve = -60 * u * (1 - u) * (1 - 2 * u) / T**2
        return self.path_time + T * gone, rate, slope, curve


class JointDrive:
    """The set point of a few joints over time.

    Args:
        names: Names of the joints.
        limits: Their bounds.
        position: Where they are, shape (n,).

    Attributes:
        state: What it is doing.
    """

    def __init__(
        self, names: tuple[str, ...], limits: DriveLimits, position: FloatArray
    ) -> None:
        self.names = names
        self.limits = limits
        self.state = DriveState.HOLDING
        self._last = _still(position)
        self._track: Track | None = None
        self._begin = 0.0
        self._stop: _Stop | None = None

    @property
    def target(self) -> FloatArray:
        """The last set point's position, shape (n,)."""
        return self._last.position

    def read(
        self,
        times: FloatArray,
        positions: FloatArray,
        velocities: FloatArray | None = None,
        accelerations: FloatArray | None = None,
    ) -> Track:
        """Make a track from points; one that begins later begins as the joints move.

        Args:
            times: Seconds from the start, shape (T,).
            positions: Shape (T, n).
            velocities: Shape (T, n); default rest at every point.
            accelerations: Shape (T, n); default none.

        Raises:
            ConfigError: If the times do not increase or a point is beyond a limit.
        """
        beyond = np.maximum(
            self.limits.lower - positions, positions - self.limits.upper
        )
        if beyond.max(initial=0.0) > POSITION_SLACK:
            joint = self.names[int(np.argmax(beyond.max(axis=0)))]
            raise ConfigError(f"{joint} would leave its limits by {beyond.max():.4f}")
        zeros = np.zeros_like(positions)
        velocities = zeros if velocities is None else velocities
        accelerations = zeros if accelerations is None else accelerations
        if len(times) and times[0] > 0.0:
            last = self._last  # its velocity is not zero where a motion is replaced
            times = np.concatenate([[0.0], times])
            positions = np.concatenate([last.position[None], positions])
            velocities = np.concatenate([last.velocity[None], velocities])
            accelerations = np.concatenate([last.acceleration[None], accelerations])
        return Track(times, positions, velocities, accelerations)

    def start(self, track: Track, now: float) -> None:
        """Follow a track from now on, in place of what was followed before."""
        self._track, self._begin, self._stop = track, now, None
        self.state = DriveState.FOLLOWING

    def stop(self, now: float) -> None:
        """Come to rest on the way, as quickly as the limits allow."""
        if self.state is not DriveState.FOLLOWING or self._track is None:
            return
        path_time = now - self._begin
        for seconds in STOP_TIMES:
            stop = _Stop(now, path_time, seconds)
            if self._keeps_limits(stop):
                break
        self._stop = stop
        self.state = DriveState.STOPPING

    def hold(self, position: FloatArray) -> None:
        """Stay at a position from now on."""
        self._last = _still(position)
        self._track, self._stop, self.state = None, None, DriveState.HOLDING

    def setpoint(self, now: float) -> Setpoint:
        """Return where the joints shall be now; ends a track or stop that is over."""
        if self._track is None:
            return self._last
        if self._stop is not None:
            point = self._stopped(self._stop, now)
            over = now >= self._stop.begin + self._stop.seconds
        else:
            point = self._track.at(now - self._begin)
            over = now >= self._begin + self._track.duration
        self._last = point
        if over:
            self.hold(point.position)
        return point

    def _stopped(self, stop: _Stop, now: float) -> Setpoint:
        """Apply the chain rule to the path and its slowed time."""
        assert self._track is not None
        s, rate, slope, curve = stop.at(now)
        p = self._track.at(s)
        return Setpoint(
            p.position,
            p.velocity * rate,
            p.acceleration * rate**2 + p.velocity * slope,
            p.jerk * rate**3 + 3 * p.acceleration * rate * slope + p.velocity * curve,
        )

    def _critical_times(self, stop: _Stop) -> FloatArray:
        """Return times since the stop's begin [s], close in every piece of the path."""
        assert self._track is not None
        even = np.linspace(0.0, stop.seconds, STOP_SAMPLES)
        path = np.array([stop.at(stop.begin + after)[0] for after in even])
        begins, spans = self._track.times[:-1], np.diff(self._track.times)
        points = (begins[:, None] + spans[:, None] * PIECE_SHARES).ravel()
        points = points[(points > path[0]) & (points < path[-1])]
        return np.concatenate([[0.0], np.interp(points, path, even), [stop.seconds]])

    def _keeps_limits(self, stop: _Stop) -> bool:
        limits = self.limits
        for after in self._critical_times(stop):
            p = self._stopped(stop, stop.begin + after)
            if (np.abs(p.velocity) > limits.velocity).any():
                return False
            if (np.abs(p.acceleration) > limits.acceleration).any():
                return False
            if (np.abs(p.jerk) > STOP_MARGIN * limits.jerk).any():
                return False
        return True
