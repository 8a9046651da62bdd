# SPDX-License-Identifier: Apache-2.0
"""One planner for all who need it: requests first, streams in between."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.nodes.scene_view import SceneView

FloatArray = NDArray[np.float64]

LINGER = 0.3  # [s] after a request's stage by which the next one has come


class Planner(Protocol):
    """The part of ``pipeline.GraspPlanner`` that the nodes use."""

    affordances: tuple[str, ...]
    encoder_passes: int
    timings: dict[str, float]

    def encode(
        self, volume: TsdfVolume, revision: int, *, support_height: float
    ) -> Any:
        """Encode a volume, or return what the same revision gave before."""

    def prepare(self, scene: Any) -> None:
        """Do what scores need once per scene."""

    def render(self, scene: Any) -> Any:
        """Return the completed surface, with ``points`` and ``normals``."""

    def sample(
        self,
        scene: Any,
        *,
        support_height: float | None,
        roi: tuple[FloatArray, FloatArray] | None,
        max_candidates: int,
        seed: int,
    ) -> GraspSet:
        """Propose grasps."""

    def contacts(self, scene: Any, grasps: GraspSet) -> FloatArray:
        """Return the expected contacts of grasps (G, 2, 3), NaN = none."""

    def evaluate(
        self, scene: Any, grasps: GraspSet, *, support_height: float
    ) -> GraspSet:
        """Score grasps; ids and order stay."""


class SharedPlanner:
    """A planner that several threads may use, one at a time.

    Args:
        planner: The planner.
        gripper: Name of its gripper.
    """

    def __init__(self, planner: Planner, gripper: str) -> None:
        self.planner = planner
        self.gripper = gripper
        self._lock = threading.Lock()
        self._asked = 0.0  # when its holder began to wait for it [s]
        self._pass = (-1, 0.0, 0.0)  # newest scene's passes: revision, begin, end [s]
        self._requests = 0
        self._answered = -LINGER  # when the last request ended, time.monotonic() [s]
        self._idle = threading.Condition()

    @contextmanager
    def request(self) -> Iterator[None]:
        """Keep streams away from the planner while somebody waits for an answer."""
        with self._idle:
            self._requests += 1
        try:
            yield
        finally:
            with self._idle:
                self._requests -= 1
                self._answered = time.monotonic()
                self._idle.notify_all()

    def serves(self) -> bool:
        """Tell whether a request is running or about to go on."""
        with self._idle:
            return bool(self._requests) or time.monotonic() < self._answered + LINGER

    def wait_for_requests(self, end: float) -> bool:
        """Return when no request is running or about to go on.

        Args:
            end: Of ``time.monotonic()``, when it returns all the same.

        Returns:
            Whether a request came first. False, too, when the time is over: whoever has
            waited that long goes on with what it has.
        """
        waited = False
        with self._idle:
            while (now := time.monotonic()) < end:
                quiet = end if self._requests else min(self._answered + LINGER, end)
                if now >= quiet:
                    return waited
                waited = True
                self._idle.wait(quiet - now)
        return False

    @contextmanager
    def timed(self) -> Iterator[dict[str, float]]:
        """Hold the planner; afterwards the yielded dict has the seconds per part."""
        seconds: dict[str, float] = {}
        asked = time.perf_counter()
        with self._lock:
            self._asked = asked
            self.planner.timings.clear()
            yield seconds
            seconds.update(self.planner.timings)

    def encode(self, view: SceneView, support_height: float) -> Any:
        """Return a scene as the planner sees it; whoever calls holds the planner.

        A pass begun for somebody else counts as far as this one had to wait for it; of
        several who waited, the first is told.

        Args:
            view: The scene.
            support_height: Height of the support plane in the task frame in [m].
        """
        planner, begin = self.planner, time.perf_counter()
        passes = planner.encoder_passes
        scene = planner.encode(
            view.volume, view.revision, support_height=support_height
        )
        if planner.encoder_passes != passes:
            self._pass = view.revision, begin, time.perf_counter()
            return scene
        revision, begin, end = self._pass
        begin = max(begin, self._asked)
        if revision == view.revision and end > begin:
            planner.timings["encoding"] = end - begin
            self._pass = revision, end, end  # told once, however many waited
        return scene

    def prepare(self, view: SceneView, support_height: float) -> None:
        """Encode a scene and get ready to score in it, before anybody asks.

        The first to come meanwhile is told the time that this made it wait. Arguments
        are those of ``encode``.
        """
        with self.timed():
            begin = time.perf_counter()
            revision, pass_begin, pass_end = self._pass
            if revision == view.revision and pass_end > self._asked:
                begin = pass_begin  # and nobody has been told of that pass
            scene = self.planner.encode(
                view.volume, view.revision, support_height=support_height
            )
            self.planner.prepare(scene)
            self._pass = view.revision, begin, time.perf_counter()
