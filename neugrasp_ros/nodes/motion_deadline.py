# SPDX-License-Identifier: Apache-2.0
"""When a motion that was sent to a controller should long have ended."""

import time
from collections.abc import Callable

LONGEST_STEP = 1.0  # [s] of the node's time; more at once is a clock that was set
STILL_TIME = 60.0  # [s] of wall time; longer, a clock that stands is no pause


class MotionDeadline:
    """Counts the time in which controllers move.

    That is the node's time: simulated time may be several times slower or faster than
    the wall clock. A clock that is set, as when a simulator starts anew, counts for no
    more than one second. Where it stands still, nothing tells a simulator that is
    paused from one that died: the wall clock then decides.

    Args:
        seconds: How long the motion may take in [s] of the node's time.
        now: Returns the node's time in [ns].
        steady: Returns wall time in [s].
    """

    def __init__(
        self,
        seconds: float,
        now: Callable[[], int],
        steady: Callable[[], float] = time.monotonic,
    ) -> None:
        self._left, self._now, self._steady = seconds, now, steady
        self._seen, self._ran = now(), steady()

    def is_over(self) -> bool:
        """Tell whether the time is over; ask at least once a second."""
        now = self._now()
        if now != self._seen:
            step = (now - self._seen) / 1e9
            self._left -= min(max(step, 0.0), LONGEST_STEP)
            self._seen, self._ran = now, self._steady()
        return self._left < 0 or self._steady() > self._ran + STILL_TIME
