# SPDX-License-Identifier: Apache-2.0
"""How many candidates are scored between two looks at the clock."""

import time
from collections.abc import Callable

BATCH = 128  # candidates at most, so that a cancel is seen in time
FIRST = 32  # before anything is known about their cost


class Pace:
    """Sizes batches so that each is expected to end within a budget.

    Args:
        end: When the budget ends, of ``clock``; None = there is none.
        clock: Seconds that go on.
    """

    def __init__(
        self, end: float | None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._end, self._clock = end, clock
        self._begun, self._count = 0.0, 0

    def next(self, left: int) -> int:
        """Return how many of the candidates that are left to score now.

        The first batch is always scored. After it, what a candidate of the batch
        before took tells how many fit into the time that is left: the budget is overrun
        by no more than one batch is dearer than the one before it.

        Returns:
            At most ``BATCH``; 0 = the budget does not suffice for another.
        """
        now = self._clock()
        count = min(left, BATCH)
        if self._end is not None:
            fit = FIRST
            if self._count:
                each = max((now - self._begun) / self._count, 1e-9)
                fit = int(max(self._end - now, 0.0) / each)
            count = min(count, fit)
        self._begun, self._count = now, count
        return count
