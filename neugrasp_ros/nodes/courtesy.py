# SPDX-License-Identifier: Apache-2.0
"""How what nobody asked for makes way for requests."""

import time
from collections.abc import Callable

PATIENCE = 5.0  # [s] that a stream lets requests go first

Wait = Callable[[float], bool]
"""Returns when no request is running, or at a time of ``time.monotonic()``; whether a
request came first, as of ``SharedPlanner.wait_for_requests``."""


class Left(Exception):  # noqa: N818 (nothing has gone wrong)
    """What a stream was working on is left: something newer has taken its place."""


class Courtesy:
    """The patience of one stream, counted from what it published last.

    Args:
        wait: Lets requests go first.
    """

    def __init__(self, wait: Wait) -> None:
        self._wait = wait
        self._end: float | None = None

    def make_way(self, is_replaced: Callable[[float], bool]) -> bool:
        """Let requests go first, and then go on unless there is something newer.

        However many are left, no publication comes later than ``PATIENCE`` allows.

        Args:
            is_replaced: Told when patience ends; asked only after a request.

        Returns:
            Whether a request came first.

        Raises:
            Left: If one did, and what is worked on has been replaced.
        """
        if self._end is None:
            self._end = time.monotonic() + PATIENCE
        waited = self._wait(self._end)
        if waited and is_replaced(self._end):
            raise Left
        return waited

    def published(self) -> None:
        """Begin to count anew."""
        self._end = None
