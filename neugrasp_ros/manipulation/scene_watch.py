# SPDX-License-Identifier: Apache-2.0
"""Whether what a grasp was computed for is still where it was."""

import threading
from collections import OrderedDict
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.fusion.tsdf import TsdfVolume, seen_surface
from neugrasp_ros.geometry.support import ABOVE_SUPPORT
from neugrasp_ros.geometry.transform import apply, invert

FloatArray = NDArray[np.float64]

KEPT = 16  # scenes remembered
SET_BACK = 10_000_000_000  # [ns]; so much older is no late scene but a clock set back
NEAR = 0.05  # [m]; around the grasp
BETWEEN = 0.03  # [m]; behind the TCP, where the object is held
LEAST_POINTS = 15
GONE_SHARE = 0.15  # of the object's seen surface that is empty space now
CLEAR_OF_SURFACE = 0.8  # of the truncation, about 15 mm


class SeenScene(NamedTuple):
    """A fused scene and where it lies.

    Attributes:
        volume: The volume.
        T_base_task: Pose of its corner in the robot's base frame, shape (4, 4).
        revision: Its number.
        stamp: Time of the newest image in it, in [ns].
    """

    volume: TsdfVolume
    T_base_task: FloatArray
    revision: int
    stamp: int


class SceneWatch:
    """Remembers scenes by their revision; threads may share it.

    Args:
        support_height: Height of the support in the task frame in [m].
    """

    def __init__(self, support_height: float) -> None:
        self._support = support_height
        self._scenes: OrderedDict[int, SeenScene] = OrderedDict()
        self._first: dict[int, int] = {}  # when a revision was first seen [ns]
        self._lock = threading.Lock()

    def remember(self, scene: SeenScene) -> None:
        """Keep a scene, or that it was seen again; the oldest one is forgotten.

        One that is older than the newest has come late and is passed over; by more
        than 10 s, the clock was set back, and what was seen before is forgotten.
        """
        with self._lock:
            newest = self._last()
            if newest is not None and scene.stamp < newest.stamp:
                if newest.stamp - scene.stamp <= SET_BACK:
                    return
                self._scenes.clear()
                self._first.clear()
            self._scenes[scene.revision] = scene
            self._scenes.move_to_end(scene.revision)
            self._first.setdefault(scene.revision, scene.stamp)
            while len(self._scenes) > KEPT:
                del self._first[self._scenes.popitem(last=False)[0]]

    @property
    def newest(self) -> SeenScene | None:
        """The scene that came last."""
        with self._lock:
            return self._last()

    def _last(self) -> SeenScene | None:
        return next(reversed(self._scenes.values()), None)

    def get(self, revision: int) -> SeenScene | None:
        """Return a scene by its number, None if it is not, or no longer, known."""
        with self._lock:
            return self._scenes.get(revision)

    def before(self, stamp: int) -> SeenScene | None:
        """Return the newest scene that is not younger than a time in [ns]."""
        with self._lock:
            scenes, first = tuple(self._scenes.values()), dict(self._first)
        found = [scene for scene in scenes if first[scene.revision] <= stamp]
        return found[-1] if found else None

    def points(self) -> FloatArray:
        """Return the newest seen surface in the base frame in [m], shape (M, 3)."""
        scene = self.newest
        if scene is None or not scene.volume.view_count:
            return np.zeros((0, 3))
        points, _ = seen_surface(scene.volume)
        return apply(scene.T_base_task, points)

    def has_moved(self, T_base_gripper: FloatArray, then: SeenScene) -> bool:
        """Tell whether what was between the jaws then has left its place by now.

        Surface that was seen near the grasp counts as gone where the newest view looks
        through it, to something at least 15 mm behind; hidden surface does not.

        Args:
            T_base_gripper: The grasp, shape (4, 4).
            then: The scene that it was computed from.
        """
        now = self.newest
        if now is None or now.revision == then.revision or not then.volume.view_count:
            return False
        points, _ = seen_surface(then.volume)
        points = points[points[:, 2] > self._support + ABOVE_SUPPORT]
        points = apply(then.T_base_task, points)
        middle = T_base_gripper[:3, 3] - BETWEEN / 2 * T_base_gripper[:3, 2]
        points = points[np.linalg.norm(points - middle, axis=1) < NEAR]
        if len(points) < LEAST_POINTS:
            return False
        values = _values(now.volume, apply(invert(now.T_base_task), points))
        return bool(np.mean(values > CLEAR_OF_SURFACE) > GONE_SHARE)


def _values(volume: TsdfVolume, points: FloatArray) -> FloatArray:
    """Return the distances of the voxels that hold points; NaN outside, shape (M,)."""
    index = np.floor(points / volume.voxel_size).astype(np.int64)
    shape = np.array(volume.distances.shape)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    values = np.full(len(points), np.nan)
    values[inside] = volume.distances[tuple(index[inside].T)]
    return values
