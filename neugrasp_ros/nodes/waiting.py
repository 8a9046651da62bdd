# SPDX-License-Identifier: Apache-2.0
"""Waits that end early: by a cancel, by a later request, with the process."""

import threading
import time
from collections.abc import Callable

from rclpy.node import Node

from neugrasp_ros.nodes.executor import PatientExecutor
from neugrasp_ros.nodes.outcomes import Code, DetectionError

MOST_WAITING = 3  # requests; each keeps a thread of the executor, which needs some more
WAKE_PERIOD = 0.1  # [s] after which who waits looks whether to stop

Stop = Callable[[], bool]
"""Says whether a wait is to end; asked every ``WAKE_PERIOD``."""


def never() -> bool:
    """Stop nothing."""
    return False


def is_ending(node: Node) -> bool:
    """Tell whether a node's process ends, so that its callbacks wait for nothing."""
    executor = node.executor
    draining = isinstance(executor, PatientExecutor) and executor.draining
    return draining or not node.context.ok()


class Ticket:
    """One request that runs or waits for its turn.

    Args:
        ends: Whether nobody shall run or wait any more.

    Attributes:
        preempted: Whether a later request wants its place.
    """

    def __init__(self, ends: Stop) -> None:
        self._ends = ends
        self.preempted = False

    def is_void(self) -> bool:
        """Tell whether its request is to leave."""
        return self.preempted or self._ends()


class Turns:
    """Lets one request run at a time; a few others wait, each in its own thread.

    Args:
        ends: Whether nobody shall run or wait any more.
    """

    def __init__(self, ends: Stop = never) -> None:
        self._ends = ends
        self._turn = threading.Lock()  # held by the request that runs
        self._changing = threading.Lock()
        self._tickets: set[Ticket] = set()
        self._waiting: set[Ticket] = set()

    def locked(self) -> bool:
        """Tell whether a request runs."""
        return self._turn.locked()

    def full(self) -> bool:
        """Tell whether so many wait that one more would be refused."""
        return len(self._waiting) >= MOST_WAITING

    def preempt(self) -> None:
        """Ask whoever runs or waits now to leave."""
        with self._changing:
            for ticket in self._tickets:
                ticket.preempted = True
            self._waiting.clear()  # who asks for their place is not refused

    def acquire(self, timeout: float, stop: Stop) -> Ticket:
        """Wait for the turn; it is held until ``release``.

        Args:
            timeout: Longest wait in [s].
            stop: Whether to wait no longer.

        Raises:
            DetectionError: TIMEOUT, at once if too many wait already; or CANCELED,
                where it is stopped or preempted.
        """
        deadline = time.monotonic() + timeout
        ticket = self._join()
        try:
            while not self._turn.acquire(timeout=_slice(deadline)):
                if stop() or ticket.is_void():
                    raise DetectionError(Code.CANCELED, "canceled before its turn came")
                if time.monotonic() >= deadline:
                    raise DetectionError(
                        Code.TIMEOUT, f"another request ran for {timeout} s"
                    )
        except BaseException:
            self._forget(ticket)
            raise
        with self._changing:
            self._waiting.discard(ticket)
        return ticket

    def _join(self) -> Ticket:
        """Return the ticket of one more who waits, if it may."""
        with self._changing:
            if self.full():
                raise DetectionError(
                    Code.TIMEOUT,
                    f"busy: {len(self._waiting)} requests wait for another one; "
                    "ask again later",
                )
            ticket = Ticket(self._ends)
            self._tickets.add(ticket)
            self._waiting.add(ticket)
        return ticket

    def release(self, ticket: Ticket) -> None:
        """Let the next one run."""
        self._forget(ticket)
        self._turn.release()

    def _forget(self, ticket: Ticket) -> None:
        with self._changing:
            self._tickets.discard(ticket)
            self._waiting.discard(ticket)


def wait_for(done: threading.Event, deadline: float, stop: Stop) -> bool:
    """Wait for an event; tell whether it came before the deadline and a stop.

    Args:
        done: The event.
        deadline: Of ``time.monotonic()`` in [s].
        stop: Whether to wait no longer.
    """
    while not done.wait(_slice(deadline)):
        if stop() or time.monotonic() >= deadline:
            return False
    return True


def _slice(deadline: float) -> float:
    """Return how long to wait before the next look, in [s]."""
    return min(max(deadline - time.monotonic(), 0.0), WAKE_PERIOD)
