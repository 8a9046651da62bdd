# SPDX-License-Identifier: Apache-2.0
import threading
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("rclpy")

from neugrasp_ros.errors import EmptySceneError  # noqa: E402
from neugrasp_ros.nodes.courtesy import Left  # noqa: E402
from neugrasp_ros.nodes.work import (  # noqa: E402
    LatestWorker,
    answer,
    from_timings,
    shielded,
    to_timings,
)


class Log:
    """A node's name and logger, remembering lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.is_up = True
        self.context = SimpleNamespace(ok=lambda: self.is_up)

    def get_name(self) -> str:
        return "some_node"

    def get_logger(self):
        def keep(line, **_):
            self.lines.append(line)

        return SimpleNamespace(info=keep, warning=keep, error=keep)


def fail(error):
    raise error


def test_a_good_answer_keeps_its_message():
    response = SimpleNamespace(success=False, message="3 grasps")
    assert answer(Log(), response, lambda: None).success
    assert response.message == "3 grasps"


def test_our_error_becomes_its_code_and_sentence():
    log, response = Log(), SimpleNamespace(success=True, message="")
    answer(log, response, lambda: fail(EmptySceneError("nothing there")))
    assert not response.success
    assert response.message == "EMPTY_WORKSPACE: nothing there" == log.lines[0]


def test_a_bug_becomes_internal_with_its_traceback_in_the_log():
    log, response = Log(), SimpleNamespace(success=True, message="")
    answer(log, response, lambda: 1 / 0)
    assert not response.success
    assert response.message.startswith("INTERNAL: some_node: ZeroDivisionError")
    assert "Traceback" in log.lines[0]


def test_a_shielded_callback_never_raises():
    log, taken = Log(), []
    shielded(log, taken.append)("message")
    shielded(log, lambda _: 1 / 0)("message")
    shielded(log, lambda _: fail(EmptySceneError("empty")))("message")
    assert taken == ["message"]
    assert "Traceback" in log.lines[0] and log.lines[1] == "empty"


def test_what_fails_because_ros_is_gone_is_not_reported_as_a_bug():
    log = Log()
    log.is_up = False
    shielded(log, lambda _: 1 / 0)("message")
    assert log.lines == []


def test_counts_and_seconds_survive_a_message():
    message = to_timings({"encoding": 0.25}, sampled=7)
    assert from_timings(message) == {"sampled": 7.0, "encoding": 0.25}
    assert from_timings("") == {}


def test_the_worker_skips_to_the_newest_item():
    started, go, done = threading.Event(), threading.Event(), []

    def work(item):
        started.set()
        go.wait(5.0)
        done.append(item)

    worker = LatestWorker(Log(), work)
    worker.put(1)
    assert started.wait(5.0)
    for item in (2, 3, 4):
        worker.put(item)
    go.set()
    deadline = time.monotonic() + 5
    while len(done) < 2 and time.monotonic() < deadline:
        time.sleep(0.005)
    worker.close()
    assert done == [1, 4]


def test_what_waits_is_known_while_another_is_worked_on_and_that_can_be_left():
    log, waiting, done = Log(), [], []
    worker = LatestWorker(log, lambda item: work(item))

    def work(item):
        if item == "old":
            waiting.append(worker.has_next())
            threading.Timer(0.1, worker.put, ["new"]).start()
            waiting.append(worker.has_next(time.monotonic() + 5.0))
            raise Left
        waiting.append(worker.has_next(time.monotonic() + 0.05))
        done.append(item)

    worker.put("old")
    deadline = time.monotonic() + 5
    while not done and time.monotonic() < deadline:
        time.sleep(0.005)
    worker.close()
    assert waiting == [False, True, False]
    assert done == ["new"] and not log.lines


def test_the_worker_outlives_errors_and_keeps_its_period():
    log, times = Log(), []

    def work(item):
        times.append(time.monotonic())
        raise EmptySceneError(f"nothing in {item}")

    worker = LatestWorker(log, work, lambda: 0.2)
    worker.put("a")
    deadline = time.monotonic() + 5
    while len(times) < 1 and time.monotonic() < deadline:
        time.sleep(0.005)
    worker.put("b")
    while len(times) < 2 and time.monotonic() < deadline:
        time.sleep(0.005)
    worker.close()
    assert log.lines == ["nothing in a", "nothing in b"]
    assert times[1] - times[0] >= 0.19


@pytest.mark.parametrize("closed", [True, False])
def test_what_fails_after_the_end_is_not_reported_as_a_bug(closed):
    log, started, go = Log(), threading.Event(), threading.Event()

    def work(_):
        started.set()
        go.wait(5.0)
        raise ZeroDivisionError

    worker = LatestWorker(log, work)
    worker.put(1)
    assert started.wait(5.0)
    closing = threading.Thread(target=worker.close)
    if closed:
        closing.start()
        time.sleep(0.05)
    go.set()
    if not closed:
        deadline = time.monotonic() + 5
        while not log.lines and time.monotonic() < deadline:
            time.sleep(0.005)
        closing.start()
    closing.join()
    assert len(log.lines) == (0 if closed else 1)
