# SPDX-License-Identifier: Apache-2.0
"""A client that clears the simulated table, over the same services as any user's."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Event
from typing import Any, TypeVar

import numpy as np
from neugrasp_msgs.msg import (
    DetectionReport,
    Grasp,
    GraspArray,
    GraspCandidates,
    TsdfVolume,
)
from neugrasp_msgs.srv import DetectGrasps, SpawnScene, TryGrasp
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image, PointCloud2

from neugrasp_ros.errors import NeuGraspError
from neugrasp_ros.grasp.ranking import quality_after_failures
from neugrasp_ros.nodes.compat.clouds import read_points
from neugrasp_ros.nodes.compat.images import read_depth
from neugrasp_ros.nodes.conversions import (
    from_grasp_array,
    from_pose,
    from_stamp,
    only,
)
from neugrasp_ros.nodes.qos import latched, newest, sensor_input
from neugrasp_ros.nodes.runtime import SPIN_PERIOD, ros
from neugrasp_ros.pictures.decision import Attempt, Decision

FloatArray = NDArray[np.float64]
ClientType = TypeVar("ClientType", bound=Node)

FAILURES_TO_STOP = 2  # in a row, as in the benchmark (method sheet, a8)
SKIPS_TO_STOP = 3  # answers without a grasp
START_TIMEOUT = 90.0  # [s], for the suite's first volume
CALL_TIMEOUT = 30.0  # [s]
SURFACE_TIMEOUT = 5.0  # [s], for the surface that belongs to an answer
LARGEST_SEED = 2**32 - 1  # that a request holds
LOADING_TIMEOUT = 90.0  # [s], for nodes that still load their model
STAGES = (
    "fusion",
    "encoding",
    "rendering",
    "sampling",
    "local_rendering",
    "quality",
    "reachability",
    "total",
)


class DemoError(NeuGraspError):
    """The suite does not answer, or answers that it cannot."""


@contextmanager
def demo_node(
    make: Callable[[Callable[[float], None]], ClientType], stopping: Event
) -> Iterator[ClientType]:
    """Bring ROS and a client up around a block.

    Signals are the caller's: once the event is set, the client's next wait ends.

    Args:
        make: Makes the client of what lets its callbacks run for up to a time in [s];
            that raises ``DemoError`` once the event is set.
        stopping: Set to end the demonstration.
    """
    with ros("demo", None, SignalHandlerOptions.NO):
        executor = SingleThreadedExecutor()

        def spin(seconds: float) -> None:
            if stopping.is_set():
                raise DemoError("stopped")
            executor.spin_once(timeout_sec=min(seconds, SPIN_PERIOD))

        client = make(spin)
        executor.add_node(client)
        try:
            yield client
        finally:
            client.destroy_node()
            executor.shutdown()


@dataclass(frozen=True, kw_only=True)
class DemoScene:
    """What a demonstration is about.

    Attributes:
        kind: Scene kind, as the bridge knows it.
        seed: Seed of the scene and of the sampler.
        n_objects: Objects asked for.
        affordance: Query of every detection.
    """

    kind: str
    seed: int
    n_objects: int
    affordance: str = ""


@dataclass
class DemoResult:
    """What came of a demonstration.

    Attributes:
        objects: How many objects the scene had.
        attempts: The executed grasps in order.
        reports: Report of every detection.
        decision: What the first detection saw and computed; None if it found nothing.
    """

    objects: int
    attempts: list[Attempt] = field(default_factory=list)
    reports: list[DetectionReport] = field(default_factory=list)
    decision: Decision | None = None

    @property
    def lifted(self) -> int:
        """Number of objects lifted."""
        return sum(attempt.success for attempt in self.attempts)


class DemoClient(Node):
    """Ask for grasps, have the best one tried, until the table is clear.

    Args:
        spin: Called to let callbacks run for up to the given time in [s].
    """

    failures_to_stop = FAILURES_TO_STOP

    def __init__(self, spin: Callable[[float], None]) -> None:
        super().__init__("demo_client")
        self._spin = spin
        self._latest: dict[str, Any] = {}
        for name, kind, topic, qos in (
            ("depth", Image, "head_front_camera/depth_registered/image_raw",
             sensor_input()),
            ("surface", PointCloud2, "rendered_cloud", latched()),
            ("candidates", GraspCandidates, "grasps/candidates", newest()),
            ("volume", TsdfVolume, "tsdf", latched()),
        ):  # fmt: skip
            self.create_subscription(kind, topic, self._keep(name), qos)
        self._detect = self.create_client(DetectGrasps, "detect_grasps")
        self._spawn = self.create_client(SpawnScene, "sim_bridge/spawn_scene")
        self._try = self.create_client(TryGrasp, "sim_bridge/try_grasp")

    def _keep(self, name: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            self._latest[name] = message

        return keep

    def wait_for_suite(self, timeout: float) -> None:
        """Wait until all services are offered and the pipeline is ready.

        Raises:
            DemoError: Naming what is still missing after ``timeout`` [s].
        """
        deadline = time.monotonic() + timeout
        clients = self.clients_needed()
        while time.monotonic() < deadline:
            missing = [c.srv_name for c in clients if not c.service_is_ready()]
            if not missing and "volume" in self._latest:
                return
            self._spin(0.1)
        raise DemoError(
            f"after {timeout:.0f} s still missing: "
            f"{', '.join(missing) or 'the first volume on tsdf'}"
        )

    def clients_needed(self) -> tuple[Any, ...]:
        """Return the clients without whose service nothing can be shown."""
        return (self._detect, self._spawn, self._try)

    def clear_table(
        self, scene: DemoScene, report: Callable[[DemoResult], None]
    ) -> DemoResult:
        """Spawn a scene and clear it by the benchmark's stop rules.

        Args:
            scene: The scene.
            report: Called after every attempt.

        Raises:
            DemoError: If a service does not answer or the scene cannot be made.
        """
        spawned = self._call(
            self._spawn,
            SpawnScene.Request(
                kind=scene.kind, seed=scene.seed, objects=scene.n_objects
            ),
        )
        if not spawned.success:
            raise DemoError(f"spawn_scene: {spawned.message}")
        self.prepare_scene(scene.kind)
        result = DemoResult(objects=len(spawned.names))
        failures = skips = 0
        failed: list[FloatArray] = []
        while (
            result.lifted < result.objects
            and failures < self.failures_to_stop
            and skips < SKIPS_TO_STOP
        ):
            answer = self._ask(scene.seed, scene.affordance)
            result.reports.append(answer.report)
            if not answer.success:
                skips += 1
                if answer.report.code == DetectionReport.EMPTY_WORKSPACE:
                    break
                continue
            if result.decision is None:
                result.decision = self._decision(answer.grasps)
            if not scene.affordance:  # else quality alone is not the server's order
                put_elsewhere_first(answer.grasps, failed)
            attempt = self._attempt(answer.grasps)
            result.attempts.append(attempt)
            failures = 0 if attempt.success else failures + 1
            if not attempt.success:
                failed.append(place_of(attempt, answer.grasps))
            report(result)
        return result

    def prepare_scene(self, kind: str) -> None:
        """Do what a new scene of a kind needs; nothing on a table."""

    def _pause(self, seconds: float) -> None:
        """Let callbacks run for a while."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._spin(left)

    def _ask(self, seed: int, affordance: str) -> DetectGrasps.Response:
        request = DetectGrasps.Request(
            scene=DetectGrasps.Request.SCENE_FRESH, affordance=affordance
        )
        request.seed = seed % LARGEST_SEED + 1  # 0 would mean random
        deadline = time.monotonic() + LOADING_TIMEOUT
        while True:
            answer = self._call(self._detect, request)
            loading = answer.report.code == DetectionReport.NOT_ACTIVE
            if not loading or time.monotonic() > deadline:
                return answer
            self._pause(1.0)

    def _attempt(self, grasps: GraspArray) -> Attempt:
        """Have a grasp of an answer carried out, and say which, and what came of it."""
        best = grasps.grasps[0]
        tried = self._call(self._try, TryGrasp.Request(grasp=only(grasps, best)))
        return attempt_of(best, tried.success, tried.message)

    def _call(self, client: Any, request: Any, timeout: float = CALL_TIMEOUT) -> Any:
        return self._await(client.call_async(request), client.srv_name, timeout)

    def _await(self, future: Any, what: str, timeout: float) -> Any:
        deadline = time.monotonic() + timeout
        while not future.done() and time.monotonic() < deadline:
            self._spin(0.05)
        if not future.done():
            raise DemoError(f"{what} gave no answer in {timeout:.0f} s")
        return future.result()

    def _has_surface_of(self, answer: GraspArray) -> bool:
        """Whether the newest rendered cloud is as new as the answer, and not empty."""
        cloud = self._latest.get("surface")
        if cloud is None or not cloud.width:
            return False
        return from_stamp(cloud.header.stamp) >= from_stamp(answer.header.stamp)

    def _decision(self, answer: GraspArray) -> Decision:
        """Gather what the latest topics say about the scene of an answer."""
        deadline = time.monotonic() + SURFACE_TIMEOUT
        while not self._has_surface_of(answer) and time.monotonic() < deadline:
            self._spin(0.1)
        grasps = from_grasp_array(answer).grasps
        volume = self._latest["volume"]
        lower = from_pose(volume.origin)[:3, 3]
        proposed = self._latest.get("candidates")
        candidates = grasps
        if proposed is not None and proposed.candidates.grasps:
            candidates = from_grasp_array(proposed.candidates).grasps
        surface = np.zeros((0, 3))
        if "surface" in self._latest:
            surface = read_points(self._latest["surface"]).astype(np.float64)
        return Decision(
            depth=read_depth(self._latest["depth"]),
            surface=surface,
            candidates=candidates.poses,
            candidate_widths=candidates.widths,
            grasps=grasps.poses,
            widths=grasps.widths,
            quality=grasps.quality,
            lower=lower,
            edge=volume.voxel_size * volume.size_x,
        )


def attempt_of(grasp: Grasp, success: bool, result: str) -> Attempt:
    """Return what came of a grasp."""
    return Attempt(grasp.quality, grasp.width, success, result, grasp.id)


def place_of(attempt: Attempt, array: GraspArray) -> FloatArray:
    """Return the TCP of the grasp that was carried out in [m], shape (3,)."""
    return next(position_of(g) for g in array.grasps if g.id == attempt.grasp)


def position_of(grasp: Grasp) -> FloatArray:
    """Return a grasp's TCP in the frame of its array in [m], shape (3,)."""
    position = grasp.pose.position
    return np.array([position.x, position.y, position.z])


def put_elsewhere_first(array: GraspArray, failed: Sequence[FloatArray]) -> None:
    """Put grasps where one has failed behind others that are nearly as good.

    Args:
        array: Grasps, best first; put into the new order.
        failed: TCPs of the failed grasps in the same frame in [m], each (3,).
    """
    if not failed:
        return
    positions = np.array([position_of(grasp) for grasp in array.grasps])
    quality = np.array([grasp.quality for grasp in array.grasps])
    left = quality_after_failures(positions, quality, np.array(failed))
    order = np.argsort(-left, kind="stable")
    array.grasps = [array.grasps[i] for i in order]


def stage_milliseconds(report: DetectionReport) -> dict[str, float]:
    """Return the milliseconds of each stage of a detection."""
    return {stage: 1e3 * getattr(report, f"seconds_{stage}") for stage in STAGES}
