# SPDX-License-Identifier: Apache-2.0
import time

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from rclpy.node import Node  # noqa: E402
from rclpy.time import Time  # noqa: E402
from scipy.spatial.transform import Rotation  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

from neugrasp_ros.geometry.transform import make_transform, translation  # noqa: E402
from neugrasp_ros.nodes.compat.tf import frame_names, from_transform  # noqa: E402
from neugrasp_ros.nodes.compat.tf_buffer import (  # noqa: E402
    Buffer,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    StaticTransformBroadcaster,
    TransformBroadcaster,
    TransformListener,
    to_transform,
)

SECOND = 10**9


def turned(angle: float, x: float = 0.0) -> np.ndarray:
    matrix = Rotation.from_rotvec([0, 0, angle]).as_matrix()
    return make_transform(matrix, np.array([x, 0.0, 0.0]))


def filled() -> Buffer:
    """base -> arm (moves) -> hand; base -> camera; map, alone with its child."""
    buffer = Buffer()
    buffer.set_transform_static(
        to_transform(translation(0, 0, 1), "base", "camera", 0), ""
    )
    buffer.set_transform_static(to_transform(turned(0.0, 0.5), "arm", "hand", 0), "")
    buffer.set_transform_static(to_transform(turned(0.0, 9.0), "map", "goal", 0), "")
    for second in (1, 2, 3):
        T_base_arm = turned(0.2 * second, float(second))
        buffer.set_transform(
            to_transform(T_base_arm, "base", "arm", second * SECOND), ""
        )
    return buffer


def test_frames_are_named_once_each_whatever_their_names():
    buffer = filled()
    assert frame_names(buffer) == ("arm", "base", "camera", "goal", "hand", "map")
    assert frame_names(Buffer()) == ()
    link = to_transform(np.eye(4), "it's", "1: [a", 0)
    buffer.set_transform_static(link, "")
    assert {"it's", "1: [a"} <= set(frame_names(buffer))


def look(buffer: Buffer, target: str, source: str, seconds: float) -> np.ndarray:
    time = Time(nanoseconds=int(seconds * SECOND))
    return from_transform(buffer.lookup_transform(target, source, time))


def test_neighbours_cancel_through_the_common_ancestor():
    buffer = filled()
    expected = translation(0, 0, -1) @ turned(0.4, 2.0) @ turned(0.0, 0.5)
    np.testing.assert_allclose(look(buffer, "camera", "hand", 2.0), expected, atol=1e-9)
    back = look(buffer, "hand", "camera", 2.0)
    np.testing.assert_allclose(back @ expected, np.eye(4), atol=1e-9)


def test_times_between_are_interpolated():
    np.testing.assert_allclose(
        look(filled(), "base", "arm", 2.5), turned(0.5, 2.5), atol=1e-9
    )


def test_time_zero_is_the_newest_common_time():
    np.testing.assert_allclose(look(filled(), "base", "arm", 0), turned(0.6, 3.0))
    np.testing.assert_allclose(look(filled(), "base", "camera", 0)[2, 3], 1.0)


def test_what_cannot_be_looked_up_says_why():
    buffer = filled()
    with pytest.raises(LookupException, match="'nowhere' does not exist"):
        look(buffer, "base", "nowhere", 1.0)
    with pytest.raises(ConnectivityException, match="same tree"):
        look(buffer, "base", "goal", 1.0)
    with pytest.raises(ExtrapolationException, match="future"):
        look(buffer, "base", "arm", 3.1)
    with pytest.raises(ExtrapolationException, match="past"):
        look(buffer, "base", "arm", 0.5)
    assert not buffer.can_transform("base", "arm", Time(seconds=4))
    assert buffer.can_transform("base", "arm", Time(seconds=3))


def test_only_the_last_ten_seconds_are_kept():
    buffer = filled()
    buffer.set_transform(to_transform(turned(0.0), "base", "arm", 12 * SECOND), "")
    with pytest.raises(ExtrapolationException, match="past"):
        look(buffer, "base", "arm", 1.0)
    look(buffer, "base", "arm", 2.5)


def test_after_time_has_jumped_back_the_new_run_counts():
    buffer = filled()
    buffer.set_transform(to_transform(turned(0.0), "base", "arm", 99 * SECOND), "")
    for second in (1, 2):
        again = to_transform(turned(0.0, 5.0 + second), "base", "arm", second * SECOND)
        buffer.set_transform(again, "")
    np.testing.assert_allclose(look(buffer, "base", "arm", 0), turned(0.0, 7.0))
    np.testing.assert_allclose(look(buffer, "base", "arm", 1.5), turned(0.0, 6.5))
    with pytest.raises(ExtrapolationException, match="future"):
        look(buffer, "base", "arm", 99.0)


def test_a_late_sample_within_the_cache_does_not_clear_it():
    buffer = filled()
    buffer.set_transform(to_transform(turned(0.0, 4.0), "base", "arm", 11 * SECOND), "")
    buffer.set_transform(to_transform(turned(0.0, 1.0), "base", "arm", 1 * SECOND), "")
    np.testing.assert_allclose(look(buffer, "base", "arm", 0), turned(0.0, 4.0))


def test_links_above_the_meeting_point_need_not_know_the_time():
    buffer = filled()
    buffer.set_transform(to_transform(turned(0.0), "odom", "base", SECOND), "")
    look(buffer, "camera", "hand", 3.0)
    with pytest.raises(ExtrapolationException, match="'base'"):
        look(buffer, "odom", "hand", 3.0)


def test_clear_keeps_the_static_ones():
    buffer = filled()
    buffer.clear()
    look(buffer, "base", "camera", 0)
    with pytest.raises(ConnectivityException):
        look(buffer, "base", "hand", 2.0)


def test_nonsense_is_refused():
    buffer = Buffer()
    with pytest.raises(InvalidArgumentException, match="empty"):
        buffer.set_transform(to_transform(np.eye(4), "", "arm", 0), "")
    with pytest.raises(InvalidArgumentException, match="own parent"):
        buffer.set_transform(to_transform(np.eye(4), "arm", "arm", 0), "")
    bad = to_transform(np.eye(4), "base", "arm", 0)
    bad.transform.translation.x = float("nan")
    with pytest.raises(InvalidArgumentException, match="not a pose"):
        buffer.set_transform(bad, "")


def test_frames_whose_names_look_like_something_else_are_names():
    class Tf2:
        def all_frames_as_yaml(self):
            return "1:\n  parent: 'base'\ncamera:\n  parent: 1\nyes:\n  parent: null\n"

    assert frame_names(Tf2()) == ("1", "base", "camera", "null", "yes")


def test_a_loop_is_found_out():
    buffer = Buffer()
    buffer.set_transform_static(to_transform(np.eye(4), "a", "b", 0), "")
    buffer.set_transform_static(to_transform(np.eye(4), "b", "a", 0), "")
    with pytest.raises(ConnectivityException, match="loop"):
        look(buffer, "a", "b", 1.0)


@pytest.mark.ros
def test_listener_hears_both_topics_and_static_ones_accumulate(spinner, wait_until):
    talker, listener = spinner.add(Node("talker")), spinner.add(Node("listener"))
    fixed = StaticTransformBroadcaster(talker)
    moving = TransformBroadcaster(talker)
    fixed.sendTransform(to_transform(translation(0, 0, 1), "base", "camera", 0))
    fixed.sendTransform([to_transform(translation(0, 2, 0), "base", "table", 0)])
    buffer = Buffer()
    TransformListener(buffer, listener)
    wait_until(
        lambda: {"camera", "table"} <= set(buffer.all_frames()), what="the static ones"
    )

    def heard() -> bool:
        moving.sendTransform(to_transform(turned(0.1, 1.0), "base", "arm", SECOND))
        return "arm" in buffer.all_frames()

    wait_until(heard, what="the moving one")
    np.testing.assert_allclose(look(buffer, "base", "arm", 1.0), turned(0.1, 1.0))


@pytest.mark.ros
def test_a_listener_that_is_slow_does_not_fall_a_queue_behind(spinner, wait_until):
    talker, slow = spinner.add(Node("talker")), Node("slow")
    moving, buffer = TransformBroadcaster(talker), Buffer()
    listener = TransformListener(buffer, slow)
    wait_until(lambda: slow.count_publishers("/tf"), what="the talker")
    wait_until(lambda: talker.count_subscribers("/tf"), what="the listener")
    for second in range(1, 31):
        moving.sendTransform(to_transform(turned(0.0), "base", "arm", second * SECOND))
    time.sleep(0.5)  # all of them have come by then, and none was taken
    listener._on_tf(TFMessage())  # the executor's one turn
    look(buffer, "base", "arm", 30.0)
    slow.destroy_node()


def test_a_transform_of_the_same_time_takes_the_place_of_the_other():
    buffer = filled()
    buffer.set_transform(to_transform(turned(0.0, 7.0), "base", "arm", 2 * SECOND), "")
    np.testing.assert_allclose(look(buffer, "base", "arm", 2.0), turned(0.0, 7.0))
    np.testing.assert_allclose(look(buffer, "base", "arm", 3.0), turned(0.6, 3.0))
