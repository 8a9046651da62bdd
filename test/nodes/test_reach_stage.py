# SPDX-License-Identifier: Apache-2.0
import threading
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList  # noqa: E402
from neugrasp_ros.nodes.params import LiveConfig  # noqa: E402
from neugrasp_ros.nodes.reach_stage import ReachStage, RobotChecker  # noqa: E402
from neugrasp_ros.nodes.settings import ReachConfig  # noqa: E402

ARMS = ("arm_left_torso", "arm_right_torso")


class Far:
    """A robot that reaches nothing, and would have to go a metre ahead."""

    base_frame, joint_names, arms = "base", (), ARMS

    def suggest_base(self, T_base_grippers, arms, start, points, boxes=()):
        assert arms
        return translation(1.0, 0.0, 0.0)


@pytest.fixture
def stage():
    return ReachStage(
        Far(), LiveConfig(ReachConfig()), lambda *_: np.eye(4), lambda: {}
    )


@pytest.fixture
def grasps():
    return GraspList(GraspInfo(frame_id="base"), GraspSet(np.eye(4)[None], np.ones(1)))


def test_an_unknown_arm_is_refused_with_the_known_ones(stage, grasps):
    with pytest.raises(ConfigError, match=r"'tail'; known: arm_left_torso, arm_right"):
        stage.suggest_base(grasps, ("tail",))
    assert stage.suggest_base(grasps, ())[0, 3] == 1.0
    assert stage.suggest_base(grasps, ARMS[:1])[0, 3] == 1.0


@pytest.fixture(scope="module")
def checker():
    return RobotChecker(ReachConfig())


def test_a_first_check_compiles_for_one_arm_and_for_all(checker, monkeypatch):
    asked = []
    monkeypatch.setattr(
        checker, "check", lambda poses, arms, start, points: asked.append(arms)
    )
    checker._try_once()
    assert asked == [ARMS[:1], ARMS]


def test_a_check_comes_between_those_of_a_base_search(checker, monkeypatch):
    free = []

    def search(robot, poses, *, turn, **_):
        free.append(not checker._lock.locked())
        with turn:
            free.append(not checker._lock.locked())
        return SimpleNamespace(reachable=0)

    monkeypatch.setattr("neugrasp_ros.robot.base_placement.suggest_base", search)
    assert checker.suggest_base(np.eye(4)[None], ARMS, {}, None) is None
    assert free == [True, False]
    assert isinstance(checker._lock, type(threading.Lock()))
