# SPDX-License-Identifier: Apache-2.0
import threading
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.standin import SideChecker  # noqa: E402

from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList  # noqa: E402
from neugrasp_ros.nodes.params import LiveConfig  # noqa: E402
from neugrasp_ros.nodes.reach_stage import (  # noqa: E402
    BATCH,
    ReachStage,
    RobotChecker,
)
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


def test_batches_are_told_what_one_list_is(grasps):
    stage = ReachStage(
        SideChecker(), LiveConfig(ReachConfig()), lambda *_: np.eye(4), lambda: {}
    )
    sides = np.where(np.arange(BATCH + 30) <= BATCH, 0.1, -0.1)
    poses = np.array([translation(0.0, y, 0.0) for y in sides])
    many = GraspList(grasps.info, GraspSet(poses, np.ones(len(poses))))
    pauses = []
    whole = stage.check(many, ARMS[1:])
    parts = stage.check(many, ARMS[1:], None, lambda: bool(pauses.append(1)))
    assert len(pauses) == 2
    assert parts.info.tcp_frame == whole.info.tcp_frame == "gripper_right_tcp"
    assert stage.reached(parts).tolist() == (sides < 0).tolist()
    np.testing.assert_array_equal(parts.reach.codes, whole.reach.codes)
    assert parts.reach.arms == whole.reach.arms
    assert stage.check(many.take(np.arange(0)), (), None, lambda: False).reach is None


@pytest.mark.parametrize("waits", [False, True])
def test_the_world_is_seen_after_waiting(grasps, waits):
    happened = []
    stage = ReachStage(
        SideChecker(),
        LiveConfig(ReachConfig()),
        lambda *_: np.eye(4),
        lambda: happened.append("look") or {},
    )
    many = grasps.take(np.zeros(2 * BATCH, dtype=np.int64))
    stage.check(many, (), None, lambda: happened.append("wait") or waits)
    assert happened == ["wait", "look", "wait"] + waits * ["look"]


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
