# SPDX-License-Identifier: Apache-2.0
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from types import SimpleNamespace

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.nodes.executor import PatientExecutor  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.remote_stages import begin  # noqa: E402
from neugrasp_ros.nodes.waiting import (  # noqa: E402
    MOST_WAITING,
    Turns,
    is_ending,
    never,
    wait_for,
)

LONG = 30.0  # [s]
SOON = 5.0  # [s], on a busy machine


@pytest.fixture
def pool():
    with ThreadPoolExecutor(8) as pool:
        yield pool


def waiting(pool, turns, wait_until, count: int = 1, stop=never) -> list[Future]:
    """Return requests that wait for their turn."""
    before = len(turns._tickets)
    asked = [pool.submit(turns.acquire, LONG, stop) for _ in range(count)]
    wait_until(lambda: len(turns._tickets) == before + count)
    return asked


def reason(asked: Future) -> Code:
    """Return why a request that waited has to leave, which it does at once."""
    error = asked.exception(SOON)
    assert isinstance(error, DetectionError)
    return error.code


def test_requests_take_turns(pool, wait_until):
    turns = Turns()
    first = turns.acquire(LONG, never)
    assert turns.locked()
    (second,) = waiting(pool, turns, wait_until)
    turns.release(first)
    turns.release(second.result(SOON))
    assert not turns.locked() and not turns._tickets


def test_who_waits_in_vain_is_told_how_long_it_was():
    turns = Turns()
    turns.acquire(LONG, never)
    with pytest.raises(DetectionError, match=r"another request ran for 0\.2 s") as late:
        turns.acquire(0.2, never)
    assert late.value.code is Code.TIMEOUT


def test_a_cancel_ends_the_wait_for_a_turn(pool, wait_until):
    turns, cancel = Turns(), threading.Event()
    turns.acquire(LONG, never)
    (asked,) = waiting(pool, turns, wait_until, stop=cancel.is_set)
    cancel.set()
    assert reason(asked) is Code.CANCELED
    assert len(turns._tickets) == 1


def test_who_comes_later_preempts_all_before_it_and_not_itself(pool, wait_until):
    turns = Turns()
    first = turns.acquire(LONG, never)
    (second,) = waiting(pool, turns, wait_until)
    turns.preempt()
    assert reason(second) is Code.CANCELED and first.is_void()
    (third,) = waiting(pool, turns, wait_until)
    turns.release(first)
    assert not third.result(SOON).is_void()


def test_one_more_than_may_wait_is_refused_at_once(pool, wait_until):
    turns = Turns()
    first = turns.acquire(LONG, never)
    asked = waiting(pool, turns, wait_until, MOST_WAITING)
    assert turns.full()
    with pytest.raises(DetectionError, match="busy: 3 requests wait") as refused:
        turns.acquire(LONG, never)
    assert refused.value.code is Code.TIMEOUT
    turns.release(first)
    for request in as_completed(asked, LONG):
        turns.release(request.result())
    assert not turns.full() and not turns.locked()


def test_who_preempts_is_not_refused_for_those_who_leave(pool, wait_until):
    turns = Turns()
    first = turns.acquire(LONG, never)
    asked = waiting(pool, turns, wait_until, MOST_WAITING)
    turns.preempt()
    assert not turns.full()
    last = pool.submit(turns.acquire, LONG, never)
    assert [reason(request) for request in asked] == [Code.CANCELED] * len(asked)
    turns.release(first)
    assert not last.result(SOON).is_void()


def test_the_end_of_the_process_ends_running_and_waiting(pool, wait_until):
    end = threading.Event()
    turns = Turns(end.is_set)
    first = turns.acquire(LONG, never)
    (second,) = waiting(pool, turns, wait_until)
    assert not first.is_void()
    end.set()
    assert first.is_void() and reason(second) is Code.CANCELED


def test_an_event_is_waited_for_until_it_comes_or_nobody_wants_it():
    done, start = threading.Event(), time.monotonic()
    assert not wait_for(done, start + 0.2, never)
    assert time.monotonic() >= start + 0.2
    assert not wait_for(done, start + LONG, lambda: True)
    done.set()
    assert wait_for(done, start, lambda: True)
    assert time.monotonic() - start < SOON


def test_a_call_of_a_stage_that_is_not_waited_for_any_more_is_forgotten():
    forgotten: list[Future] = []
    client = SimpleNamespace(
        call_async=lambda _: Future(),
        remove_pending_request=forgotten.append,
        srv_name="stage/work",
    )
    wait = begin(client, None)
    with pytest.raises(DetectionError, match="canceled while stage/work") as canceled:
        wait(time.monotonic() + LONG, lambda: True)
    with pytest.raises(DetectionError, match="no answer from stage/work") as late:
        wait(time.monotonic() + 0.1, never)
    assert canceled.value.code is Code.CANCELED and late.value.code is Code.TIMEOUT
    assert len(forgotten) == 2


@pytest.mark.ros
def test_a_node_ends_with_its_executor_and_with_ros(ros):
    from rclpy.context import Context
    from rclpy.node import Node

    context = Context()
    context.init(args=[])
    node = Node("ending", context=context)
    executor = PatientExecutor(2, context=context)
    executor.add_node(node)
    assert not is_ending(node)
    executor.drain()
    assert is_ending(node)
    executor.shutdown()
    node.destroy_node()
    alone = Node("alone", context=context)
    assert not is_ending(alone)
    alone.destroy_node()
    context.try_shutdown()
    assert is_ending(alone)
