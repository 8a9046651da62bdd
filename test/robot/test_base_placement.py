# SPDX-License-Identifier: Apache-2.0
import numpy as np

from neugrasp_ros.geometry.transform import invert, make_transform
from neugrasp_ros.robot.base_placement import suggest_base
from neugrasp_ros.robot.obstacles import SolidBox

DOWN = np.diag([1.0, -1.0, -1.0])


def test_a_grasp_out_of_reach_is_reached_from_the_place(reach):
    grasps = make_transform(DOWN, np.array([[1.3, 0.1, 0.8], [1.3, 0.0, 0.8]]))
    assert not reach.check(grasps).reachable.any()

    place = suggest_base(reach, grasps)

    assert place.reachable == 2
    assert place.T_base_place[0, 3] > 0.2  # ahead
    assert reach.check(invert(place.T_base_place) @ grasps).reachable.all()


def test_the_place_is_not_in_the_table(reach):
    grasps = make_transform(DOWN, np.array([[1.3, 0.0, 0.82]]))
    low = make_transform(np.eye(3), np.array([1.5, 0.0, 0.4]))
    cupboard = SolidBox(low, np.array([0.8, 1.2, 0.7]))

    place = suggest_base(reach, grasps, boxes=[cupboard])

    assert place.reachable == 1
    x, y = place.T_base_place[:2, 3]
    away = np.maximum(np.abs([x - 1.5, y]) - [0.4, 0.6], 0.0)
    assert np.hypot(*away) > 0.27


def test_seen_points_keep_the_base_away(reach):
    grasps = make_transform(DOWN, np.array([[1.2, 0.0, 0.9]]))
    free = suggest_base(reach, grasps)
    x, y = free.T_base_place[:2, 3]
    post = np.array([[x, y, 0.2]])
    assert not np.allclose(
        suggest_base(reach, grasps, points_base=post).T_base_place, free.T_base_place
    )


class Turn:
    inside, entered = False, 0

    def __enter__(self):
        self.inside, self.entered = True, self.entered + 1

    def __exit__(self, *_):
        self.inside = False


def test_the_turn_is_taken_for_each_check(reach, monkeypatch):
    turn, checks, check = Turn(), [], reach.check

    def watched(*args, **options):
        checks.append(turn.inside)
        return check(*args, **options)

    monkeypatch.setattr(reach, "check", watched)
    suggest_base(reach, make_transform(DOWN, np.array([[1.3, 0.1, 0.8]])), turn=turn)
    assert checks and all(checks)
    assert turn.entered == len(checks) and not turn.inside


def test_no_place_reaches_what_is_too_high(reach):
    grasps = make_transform(DOWN, np.array([[0.6, 0.0, 3.0]]))
    place = suggest_base(reach, grasps)
    assert place.reachable == 0
    assert np.array_equal(place.T_base_place, np.eye(4))
