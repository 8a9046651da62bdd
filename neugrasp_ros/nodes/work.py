# SPDX-License-Identifier: Apache-2.0
"""Work outside of callbacks, and answers whatever happens."""

import threading
import time
import traceback
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from rclpy.node import Node

from neugrasp_ros.errors import NeuGraspError
from neugrasp_ros.nodes.courtesy import Left
from neugrasp_ros.nodes.outcomes import Code, to_message

Item = TypeVar("Item")
Message = TypeVar("Message")

JOIN_TIME = 5.0  # [s]


def answer(node: Node, response: Any, work: Callable[[], object]) -> Any:
    """Run the work of a stage service and fill success and message.

    Args:
        node: For the log.
        response: A response with ``success`` and ``message``.
        work: Fills the rest of the response; may set ``message``.

    Returns:
        The response: with ``CODE: sentence`` after an error of ours, and with
        ``INTERNAL`` after any other, which goes to the log with its traceback.
    """
    try:
        work()
        response.success = True
    except NeuGraspError as error:
        response.success, response.message = False, to_message(error)
        node.get_logger().warning(response.message)
    except Exception as error:  # noqa: BLE001 (a bug must not end the node)
        log_bug(node)
        response.success = False
        response.message = f"{Code.INTERNAL.name}: {node.get_name()}: {error!r}"
    return response


def log_bug(node: Node) -> None:
    """Log the exception being handled, with its traceback.

    While the process ends, publishers and clients go before the work that uses them;
    what fails then is no bug.
    """
    if node.context.ok():
        node.get_logger().error(traceback.format_exc())


def shielded(
    node: Node, callback: Callable[[Message], object]
) -> Callable[[Message], None]:
    """Return a subscription's callback whose errors end in the log, not the process.

    Args:
        node: For the log.
        callback: Takes the message.
    """

    def call(message: Message) -> None:
        try:
            callback(message)
        except NeuGraspError as error:
            node.get_logger().warning(str(error), throttle_duration_sec=5.0)
        except Exception:  # noqa: BLE001 (a bug must not end the node)
            log_bug(node)

    return call


def to_timings(seconds: dict[str, float], **counts: int) -> str:
    """Return counts and seconds as the ``message`` of a stage's good answer."""
    parts = [f"{name}={count}" for name, count in counts.items()]
    parts += [f"{name}={value:.6f}" for name, value in seconds.items()]
    return " ".join(parts)


def from_timings(message: str) -> dict[str, float]:
    """Return the numbers that ``to_timings`` wrote."""
    pairs = (part.partition("=") for part in message.split())
    return {name: float(value) for name, sign, value in pairs if sign}


class LatestWorker(Generic[Item]):
    """A thread that works on the newest item and skips those that came meanwhile.

    Args:
        node: For the log.
        work: Called with each item that is taken; may raise ``Left``.
        min_period: Returns the least time between two items in [s].
    """

    def __init__(
        self,
        node: Node,
        work: Callable[[Item], None],
        min_period: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self._node = node
        self._work = work
        self._min_period = min_period
        self._item: Item | None = None
        self._closed = False
        self._ready = threading.Condition()
        self._thread = threading.Thread(
            target=self._run, name=f"{node.get_name()}_worker", daemon=True
        )
        self._thread.start()

    def put(self, item: Item) -> None:
        """Hand over an item; one that waits is replaced."""
        with self._ready:
            self._item = item
            self._ready.notify()

    def has_next(self, end: float = 0.0) -> bool:
        """Tell, while one item is worked on, whether another waits.

        Args:
            end: Of ``time.monotonic()``; until then it may still come.

        Returns:
            True, too, if the thread is to end.
        """
        with self._ready:
            self._ready.wait_for(
                lambda: self._item is not None or self._closed,
                timeout=max(end - time.monotonic(), 0.0),
            )
            return self._item is not None or self._closed

    def close(self) -> None:
        """End the thread after its present item."""
        with self._ready:
            self._closed = True
            self._ready.notify()
        self._thread.join(timeout=JOIN_TIME)

    def _run(self) -> None:
        next_start = 0.0
        while True:
            with self._ready:
                while not self._closed and (
                    self._item is None or time.monotonic() < next_start
                ):
                    early = max(next_start - time.monotonic(), 0.0)
                    self._ready.wait(None if self._item is None else early)
                if self._closed:
                    return
                item, self._item = self._item, None
            next_start = time.monotonic() + self._min_period()
            self._do(item)  # type: ignore[arg-type]

    def _do(self, item: Item) -> None:
        try:
            self._work(item)
        except Left:
            return
        except NeuGraspError as error:
            self._node.get_logger().warning(str(error), throttle_duration_sec=5.0)
        except Exception:  # noqa: BLE001 (a bug must not end the node)
            if not self._closed:  # else what it publishes with may be gone already
                log_bug(self._node)
