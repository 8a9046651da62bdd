# SPDX-License-Identifier: Apache-2.0
import time

import pytest

from neugrasp_ros.nodes.courtesy import PATIENCE, Courtesy, Left


def never_asked(_: float) -> bool:
    raise AssertionError("nobody came first, so nothing can have replaced it")


def test_without_requests_it_goes_on_whatever_has_come():
    assert not Courtesy(lambda _: False).make_way(never_asked)


def test_after_a_request_it_goes_on_only_with_what_is_newest():
    courtesy = Courtesy(lambda _: True)
    assert courtesy.make_way(lambda _: False)
    with pytest.raises(Left):
        courtesy.make_way(lambda _: True)


def test_patience_goes_on_over_what_is_left_and_ends_with_a_publication():
    ends: list[float] = []

    def wait(end: float) -> bool:
        ends.append(end)
        return True

    courtesy = Courtesy(wait)
    for _ in range(2):
        with pytest.raises(Left):
            courtesy.make_way(lambda end: end == ends[0])
        time.sleep(0.01)
    courtesy.published()
    courtesy.make_way(lambda _: False)
    assert ends[0] == ends[1] < ends[2] <= time.monotonic() + PATIENCE
