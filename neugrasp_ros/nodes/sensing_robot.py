# SPDX-License-Identifier: Apache-2.0
"""The robot as the grasp executor wants it: it moves, and it looks before it says."""

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from neugrasp_msgs.msg import TsdfVolume
from neugrasp_msgs.srv import GetTsdf
from numpy.typing import NDArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from neugrasp_ros.errors import NeuGraspError
from neugrasp_ros.manipulation.mover import ArmMover, Surroundings
from neugrasp_ros.manipulation.scene_watch import SceneWatch, SeenScene
from neugrasp_ros.motion.limits import Trajectory
from neugrasp_ros.robot.obstacles import SolidBox

FloatArray = NDArray[np.float64]

SERVICE = "tsdf_fusion/get_tsdf"
POLL = 0.02  # [s]
ASK_PERIOD = 0.1  # [s] between two questions for the newest volume


class Driver(Protocol):
    """What moves a robot and measures its joints; ``Controllers`` does."""

    def configuration(self) -> FloatArray:
        """Return the measured configuration, shape (J,)."""

    def check_stop(self) -> None:
        """Raise ``CanceledError`` where a stop was requested."""

    def follow(self, group: str, motion: Trajectory) -> None:
        """Carry out a motion."""

    def move_jaws(self, gripper: str, opening: float) -> None:
        """Bring jaws to an opening in [m], or until they hold something."""

    def opening(self, gripper: str) -> float:
        """Return the measured opening of jaws in [m]."""


class FreshViews:
    """Brings views that are young enough, from the topic or by asking for them.

    A volume is published when it changes. Of a scene in which nothing moves only its
    service tells that it was seen again.

    Args:
        node: Node that owns the client.
        watch: Remembers what was seen.
        take: Takes a volume that was asked for, as one of the topic.
        patience: Longest wait in [s].
    """

    def __init__(
        self,
        node: Node,
        watch: SceneWatch,
        take: Callable[[TsdfVolume], None],
        patience: float,
    ) -> None:
        self._node, self._watch, self._take = node, watch, take
        self._patience = patience
        self._client = node.create_client(
            GetTsdf, SERVICE, callback_group=ReentrantCallbackGroup()
        )

    def wait(self, since: int) -> bool:
        """Wait for a view not older than a time in [ns]; tell whether one came."""
        deadline = time.monotonic() + self._patience
        next_question = 0.0
        pending: Any = None
        while not self._is_fresh(since):
            now = time.monotonic()
            if now > deadline:
                self._node.get_logger().warning(
                    f"no view since the robot moved within {self._patience:.1f} s"
                )
                return False
            if pending is not None and pending.done():
                self._use(pending.result())
                pending, next_question = None, now + ASK_PERIOD
            elif pending is None and now >= next_question:
                if self._client.service_is_ready():
                    pending = self._client.call_async(GetTsdf.Request())
            time.sleep(POLL)
        return True

    def _is_fresh(self, since: int) -> bool:
        newest = self._watch.newest
        return newest is not None and newest.stamp >= since

    def _use(self, answer: Any) -> None:
        """Take the answer, if there is a volume in it and its place is known."""
        if answer is None or not answer.success:
            return
        try:
            self._take(answer.volume)
        except NeuGraspError as error:
            self._node.get_logger().warning(str(error), throttle_duration_sec=5.0)


class SensingRobot:
    """The robot and what it sees; what is told was seen after it last moved.

    Args:
        driver: Moves the robot.
        mover: Knows its shape.
        watch: Remembers what was seen.
        wait_for_view: Waits for a view not older than a time in [ns].
        now: Returns the present time in [ns].
        boxes: Returns the known solid boxes, in the base frame as it stands now.

    Attributes:
        seen_in: The scene that the grasp was computed from; None = unknown.
    """

    def __init__(
        self,
        driver: Driver,
        mover: ArmMover,
        watch: SceneWatch,
        wait_for_view: Callable[[int], bool],
        now: Callable[[], int],
        boxes: Callable[[], tuple[SolidBox, ...]] = lambda: (),
    ) -> None:
        self._driver, self._mover, self._watch = driver, mover, watch
        self._wait_for_view, self._now, self._boxes = wait_for_view, now, boxes
        self._changed = 0  # when it last moved, or was told to look anew [ns]
        self.seen_in: SeenScene | None = None

    def look_anew(self) -> None:
        """Hold nothing for true that was seen before now."""
        self._changed = self._now()

    def configuration(self) -> FloatArray:
        """Return the measured configuration, shape (J,)."""
        return self._driver.configuration()

    def check_stop(self) -> None:
        """Raise ``CanceledError`` where a stop was requested."""
        self._driver.check_stop()

    def follow(self, group: str, motion: Trajectory) -> None:
        """Carry out a motion."""
        try:
            self._driver.follow(group, motion)
        finally:
            self.look_anew()

    def move_jaws(self, gripper: str, opening: float) -> None:
        """Bring jaws to an opening in [m], or until they hold something."""
        try:
            self._driver.move_jaws(gripper, opening)
        finally:
            self.look_anew()

    def opening(self, gripper: str) -> float:
        """Return the measured opening of jaws in [m]."""
        return self._driver.opening(gripper)

    def surroundings(self) -> Surroundings:
        """Return what is seen now, without the robot itself, and the boxes.

        Raises:
            DetectionError: If the frame of a box is not connected to the base.
        """
        self._wait_for_view(self._changed)
        points = self._watch.points()
        if len(points):
            collisions = self._mover.checker.collisions
            points = points[collisions.off_robot(points, self.configuration())]
        return Surroundings(points, self._boxes())

    def has_moved(self, T_base_gripper: FloatArray) -> bool:
        """Tell whether the thing to grasp left its place since it was seen."""
        if self.seen_in is None:
            return False
        self._wait_for_view(self._changed)
        return self._watch.has_moved(T_base_gripper, self.seen_in)
