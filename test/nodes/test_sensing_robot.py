# SPDX-License-Identifier: Apache-2.0
"""The robot that looks before it says, with a clock and views in our hands."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.srv import GetTsdf  # noqa: E402
from rclpy.node import Node  # noqa: E402

from neugrasp_ros.errors import MotionError  # noqa: E402
from neugrasp_ros.fusion.tsdf import empty_volume  # noqa: E402
from neugrasp_ros.manipulation.scene_watch import SceneWatch, SeenScene  # noqa: E402
from neugrasp_ros.nodes.conversions import from_stamp, to_stamp  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.sensing_robot import (  # noqa: E402
    SERVICE,
    FreshViews,
    SensingRobot,
)
from neugrasp_ros.robot.obstacles import SolidBox  # noqa: E402

VOLUME = empty_volume((4, 4, 4), 0.3, 4.0)


def scene(revision: int, stamp: int) -> SeenScene:
    return SeenScene(VOLUME, np.eye(4), revision, stamp)


class Driver:
    fails = False

    def configuration(self):
        return np.zeros(2)

    def follow(self, group, motion):
        if self.fails:
            raise MotionError("blocked")

    def check_stop(self):
        pass

    def move_jaws(self, gripper, opening):
        pass

    def opening(self, gripper):
        return 0.05


class Rig:
    def __init__(self) -> None:
        self.time = 100
        self.driver, self.watch = Driver(), SceneWatch(0.05)
        self.asked: list[int] = []
        mover = SimpleNamespace(checker=SimpleNamespace(collisions=None))
        self.boxes: list[SolidBox] = []
        self.robot = SensingRobot(
            self.driver, mover, self.watch, self.wait, lambda: self.time, self.known
        )

    def known(self):
        if self.boxes is None:
            raise DetectionError(Code.TF_ERROR, "base <- map: not known")
        return tuple(self.boxes)

    def wait(self, since: int) -> bool:
        self.asked.append(since)
        return True


def test_what_is_around_was_seen_after_the_last_motion():
    rig = Rig()
    rig.robot.look_anew()
    rig.robot.surroundings()
    rig.time = 200
    rig.robot.follow("arm", None)
    rig.time = 300
    rig.robot.surroundings()
    rig.robot.move_jaws("left", 0.0)
    rig.time = 400
    rig.robot.surroundings()
    assert rig.asked == [100, 200, 300]


def test_boxes_are_those_of_the_moment_or_there_is_no_answer():
    rig = Rig()
    assert rig.robot.surroundings().boxes == ()
    rig.boxes.append(SolidBox(np.eye(4), np.ones(3)))
    assert rig.robot.surroundings().boxes == tuple(rig.boxes)
    rig.boxes = None
    with pytest.raises(DetectionError, match="base <- map"):
        rig.robot.surroundings()


def test_a_motion_that_failed_has_changed_the_scene_too():
    rig = Rig()
    rig.driver.fails, rig.time = True, 500
    with pytest.raises(MotionError):
        rig.robot.follow("arm", None)
    rig.robot.seen_in = scene(1, 50)
    rig.time = 600
    assert not rig.robot.has_moved(np.eye(4))
    assert rig.asked == [500]


def test_nobody_waits_where_the_scene_of_a_grasp_is_unknown():
    rig = Rig()
    assert not rig.robot.has_moved(np.eye(4)) and rig.asked == []


class Fusion(Node):
    """Answers with a volume that grows older by one with each question."""

    def __init__(self, stamps: list[int]) -> None:
        super().__init__("fusion")
        self.stamps, self.questions = stamps, 0
        self.create_service(GetTsdf, SERVICE, self.on_get)

    def on_get(self, request, response):
        self.questions += 1
        response.success = bool(self.stamps)
        if self.stamps:
            response.volume.header.stamp = to_stamp(self.stamps.pop(0))
        return response


def fresh_views(spinner, patience: float):
    watch, node = SceneWatch(0.05), spinner.add(Node("asker"))

    def take(volume) -> None:
        watch.remember(scene(1, from_stamp(volume.header.stamp)))

    return watch, FreshViews(node, watch, take, patience)


@pytest.mark.ros
def test_a_scene_that_does_not_change_is_asked_for_until_it_is_young_enough(spinner):
    fusion = spinner.add(Fusion([10, 20, 30, 40]))
    watch, views = fresh_views(spinner, 30.0)
    assert views.wait(30)
    assert watch.newest.stamp == 30 and fusion.questions == 3
    assert views.wait(25) and fusion.questions == 3, "what is known is not asked for"


@pytest.mark.ros
def test_a_view_that_comes_by_itself_ends_the_wait(spinner):
    watch, views = fresh_views(spinner, 30.0)
    threading.Timer(0.2, lambda: watch.remember(scene(2, 50))).start()
    assert views.wait(50)


@pytest.mark.ros
def test_without_a_view_it_goes_on_after_its_patience(spinner):
    spinner.add(Fusion([]))
    watch, views = fresh_views(spinner, 0.3)
    assert not views.wait(1)
    assert watch.newest is None
