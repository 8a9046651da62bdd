# SPDX-License-Identifier: Apache-2.0
import threading
import time

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.fusion.tsdf import empty_volume  # noqa: E402
from neugrasp_ros.nodes.scene_view import SceneView  # noqa: E402
from neugrasp_ros.nodes.shared_planner import LINGER, SharedPlanner  # noqa: E402

PASS = 0.3  # [s] that a pass takes


class SlowPlanner:
    """Encodes each revision once, slowly."""

    def __init__(self) -> None:
        self.encoder_passes = 0
        self.timings: dict[str, float] = {}
        self.begun, self.prepared = threading.Event(), threading.Event()
        self._revision = -1

    def encode(self, volume, revision, *, support_height):
        if revision != self._revision:
            self.begun.set()
            time.sleep(PASS)
            self.encoder_passes += 1
            self.timings["encoding"] = PASS
            self._revision = revision
        return revision

    def prepare(self, scene):
        self.prepared.set()
        time.sleep(PASS)


@pytest.fixture
def shared() -> SharedPlanner:
    return SharedPlanner(SlowPlanner(), "any")


def view(revision: int) -> SceneView:
    return SceneView(
        volume=empty_volume(2),
        T_frame_task=np.eye(4),
        frame_id="base",
        stamp=1,
        revision=revision,
    )


def encoded(shared: SharedPlanner, revision: int) -> dict[str, float]:
    with shared.timed() as seconds:
        assert shared.encode(view(revision), 0.05) == revision
    return seconds


def test_a_pass_counts_for_whoever_makes_it_and_not_for_who_comes_later(shared):
    assert encoded(shared, 1)["encoding"] == pytest.approx(PASS, abs=0.2)
    assert "encoding" not in encoded(shared, 1)
    assert shared.planner.encoder_passes == 1


def test_a_pass_of_another_counts_as_far_as_it_was_waited_for(shared):
    other = threading.Thread(target=encoded, args=(shared, 1))
    other.start()
    assert shared.planner.begun.wait(5.0)
    time.sleep(PASS / 2)
    start = time.perf_counter()
    counted = encoded(shared, 1)["encoding"]
    assert 0 < counted <= time.perf_counter() - start
    other.join()
    assert shared.planner.encoder_passes == 1


def test_the_time_for_another_scene_does_not_count(shared):
    other = threading.Thread(target=encoded, args=(shared, 1))
    other.start()
    assert shared.planner.begun.wait(5.0)
    start = time.perf_counter()
    counted = encoded(shared, 2)["encoding"]
    assert counted < time.perf_counter() - start - PASS / 4
    other.join()


def test_getting_ready_counts_as_far_as_it_was_waited_for(shared):
    other = threading.Thread(target=shared.prepare, args=(view(1), 0.05))
    other.start()
    assert shared.planner.prepared.wait(5.0)  # encoded, and not ready yet
    start = time.perf_counter()
    counted = encoded(shared, 1)["encoding"]
    assert PASS / 4 < counted <= time.perf_counter() - start
    other.join()
    assert "encoding" not in encoded(shared, 1)


def told_who_asked(shared: SharedPlanner, asked: float) -> float:
    """Return what somebody is told who has waited since a time."""
    with shared.timed() as seconds:
        shared._asked = asked
        shared.encode(view(1), 0.05)
    return seconds["encoding"]


def test_getting_ready_does_not_count_what_others_did_since_the_pass(shared):
    encoded(shared, 1)
    asked = time.perf_counter()
    with shared.timed():  # scoring, say
        time.sleep(PASS)
    begin = time.perf_counter()
    shared.prepare(view(1), 0.05)
    most = time.perf_counter() - begin
    assert PASS <= told_who_asked(shared, asked) <= most


def test_getting_ready_counts_beside_a_pass_that_it_waited_for_itself(shared):
    maker = threading.Thread(target=encoded, args=(shared, 1))
    maker.start()
    assert shared.planner.begun.wait(5.0)
    asked = time.perf_counter()
    shared.prepare(view(1), 0.05)
    most = time.perf_counter() - asked
    maker.join()
    assert 1.3 * PASS < told_who_asked(shared, asked) <= most


def test_of_several_who_wait_one_is_told(shared):
    told: list[dict[str, float]] = []
    threads = [threading.Thread(target=shared.prepare, args=(view(1), 0.05))]
    threads[0].start()
    assert shared.planner.prepared.wait(5.0)
    for _ in range(2):
        threads.append(threading.Thread(target=lambda: told.append(encoded(shared, 1))))
        threads[-1].start()
    for thread in threads:
        thread.join()
    assert sum("encoding" in seconds for seconds in told) == 1


def test_who_waited_is_told_unless_patience_ended(shared):
    assert not shared.wait_for_requests(time.monotonic() + 5.0)
    with shared.request():
        assert not shared.wait_for_requests(time.monotonic() + 0.1)
    assert shared.wait_for_requests(time.monotonic() + 30.0)  # LINGER


def waited(shared: SharedPlanner, seconds: float) -> float:
    start = time.monotonic()
    shared.wait_for_requests(start + seconds)
    return time.monotonic() - start


def test_a_stream_waits_for_the_request_and_for_what_it_may_ask_next(shared):
    assert waited(shared, 5.0) < LINGER
    with shared.request():
        assert waited(shared, 0.2) >= 0.2  # patience has an end
    assert LINGER / 2 < waited(shared, 30.0) < 10.0
    assert waited(shared, 5.0) < LINGER
