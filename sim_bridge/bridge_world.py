# SPDX-License-Identifier: Apache-2.0
"""A world that lives: physics in a thread of its own, at the pace of real time.

Only that thread touches the engine. Others hand it jobs and read snapshots.
"""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import SimulationError, UnknownNameError
from neugrasp_ros.geometry.gripper import Gripper
from sim_bridge.gripper import SimGripper
from sim_bridge.objects.model import ObjectModel
from sim_bridge.objects.registry import ObjectSet, object_set, split
from sim_bridge.scene import SCENE_KINDS
from sim_bridge.scenes import build_scene
from sim_bridge.trial import TRIAL_PRESETS, run_trial
from sim_bridge.trial_result import TrialResult
from sim_bridge.vgn_trial import VgnRules
from sim_bridge.world import TIME_STEP, World

FloatArray = NDArray[np.float64]

_log = logging.getLogger(__name__)

PACE_STEPS = 4  # physics steps between two looks at the wall clock
STEP_NS = round(TIME_STEP * 1e9)
LARGEST_LAG = 0.25  # [s]; a longer one is given up, not caught up
LEAST_PAUSE = 0.25  # of the time spent on physics, left to the process's other threads
SHORTEST_WAIT = 0.01  # [s]; shorter ones are put together: each may cost as much more
REST_TIME = 0.5  # [s] of simulated time that nothing moves before it rests
REST_CHANGE = 2e-4  # [m], [rad], [-]; a smaller change in that time is no motion
KINDS = (*SCENE_KINDS, "affordance")
EMPTY = ("empty", 0, 0)  # kind, seed and count of the scene that needs no objects


class Snapshot(NamedTuple):
    """Where everything was at one time.

    Attributes:
        time: Simulated time in [ns].
        names: Names of the objects.
        models: Their models.
        poses: Their poses ``T_task_object``, shape (B, 4, 4).
        robot: The robot, where there is a whole one.
    """

    time: int
    names: tuple[str, ...]
    models: tuple[ObjectModel, ...]
    poses: FloatArray
    robot: Any = None


class _PacedWorld(World):
    """A world that reports every few steps."""

    def __init__(self, on_steps: Callable[[int], None]) -> None:
        self._on_steps = on_steps
        super().__init__(sleeping=True)

    def step(self, count: int = 1) -> None:
        """Advance time, a few steps at a time."""
        for start in range(0, count, PACE_STEPS):
            steps = min(PACE_STEPS, count - start)
            super().step(steps)
            self._on_steps(steps)


@dataclass(frozen=True, slots=True)
class BridgeScenes:
    """Which objects scenes are made of.

    Attributes:
        objects: Name of an object set, or a folder.
        part: ``val``, ``tune``, ``train`` or ``all`` of its names.
    """

    objects: str = "procedural"
    part: str = "val"

    def load(self, kind: str) -> tuple[ObjectSet, tuple[str, ...]]:
        """Return the set of a scene kind and the names to draw from.

        Raises:
            UnknownNameError: If kind, set or part is unknown.
        """
        if kind not in KINDS:
            raise UnknownNameError("scene kind", kind, KINDS)
        objects = object_set("affordance" if kind == "affordance" else self.objects)
        if self.part == "all":
            return objects, objects.names
        return objects, split(objects.names, self.part)


class BridgeWorld:
    """Physics of table, objects and a free-flying gripper.

    Args:
        gripper: The gripper that tries grasps.
        scenes: What scenes are made of.
        realtime_factor: Simulated over real time; 0 = as fast as possible, but for
            pauses in which the process's other threads work.
        lockstep: Time goes on only with ``advance``.

    Raises:
        SimulationError: If the engine does not start.
    """

    def __init__(
        self,
        gripper: Gripper,
        scenes: BridgeScenes,
        realtime_factor: float = 1.0,
        *,
        lockstep: bool = False,
    ) -> None:
        self._lockstep = lockstep
        self.gripper = gripper
        self.scenes = scenes
        self.realtime_factor = realtime_factor
        self._jobs: deque[tuple[Future[Any], Callable[[], Any]]] = deque()
        self._wake = threading.Condition()
        self._closed = False
        self._ended = ""
        self._live = False
        self._time = 0
        self._working = False  # on a job
        self._due = self._resumed = self._pause_end = time.monotonic()
        self._still: tuple[int, FloatArray | None] = (0, None)  # since when [ns], where
        self.snapshot = Snapshot(0, (), (), np.zeros((0, 4, 4)))
        self.measured_factor = 0.0
        self._mark = (time.monotonic(), 0)
        self._last_spawn = EMPTY
        self._thread = threading.Thread(target=self._run, name="physics", daemon=True)
        self._thread.start()
        self.do(lambda: self._spawn(*self._last_spawn)).result()

    def do(self, job: Callable[[], Any]) -> "Future[Any]":
        """Run a job in the physics thread.

        Returns:
            Its result to come; a ``SimulationError`` where the world ends before.
        """
        future: Future[Any] = Future()
        with self._wake:
            if self._ended:
                future.set_exception(SimulationError(self._ended))
                return future
            self._jobs.append((future, job))
            self._wake.notify()
        return future

    def advance(self, seconds: float, until: Callable[[], bool] | None = None) -> None:
        """Let simulated time go on by a whole number of physics steps.

        Args:
            seconds: How long; with ``until``, the time between two questions.
            until: Asked in the physics thread whether that is enough; None = at once.
        """
        steps = max(1, round(seconds / TIME_STEP))

        def work() -> None:
            self._world.step(steps)
            while until is not None and not until():
                self._world.step(steps)
            self.snapshot = self._look()

        self.do(work).result()

    @property
    def ended(self) -> str:
        """Why time stands still and no job is done any more; empty while it lives."""
        return self._ended

    def close(self) -> None:
        """End the thread and the engine."""
        with self._wake:
            self._closed = True
            self._wake.notify()
        self._thread.join()

    def spawn(self, kind: str, seed: int, count: int) -> tuple[str, ...]:
        """Clear the table and put a seeded scene onto it; return the objects' names.

        Where that fails, the last scene that did not is built again.

        Raises:
            UnknownNameError: If the kind is unknown.
            SimulationError: If the engine refuses an object.
        """
        self.check_kind(kind)
        names = self.do(lambda: self._spawn(kind, seed, count)).result()
        return tuple(names)

    def check_kind(self, kind: str) -> None:
        """Refuse an unknown scene kind.

        Raises:
            UnknownNameError: If it, or the object set, is unknown.
        """
        self.scenes.load(kind)

    def reset(self) -> tuple[str, ...]:
        """Build the last scene again; return the objects' names."""
        return self.spawn(*self._last_spawn)

    def try_grasp(
        self, T_task_gripper: FloatArray, opening: float, lift_height: float
    ) -> TrialResult:
        """Try a grasp; an object that was lifted is taken away.

        Args:
            T_task_gripper: Grasp pose, shape (4, 4).
            opening: Of the jaws on approach in [m].
            lift_height: Length of the retreat in [m]; 0 = the benchmark's.

        Raises:
            SimulationError: If the jaws do not open that far.
        """
        job = self.do(lambda: self._try_grasp(T_task_gripper, opening, lift_height))
        result: TrialResult = job.result()
        return result

    def _run(self) -> None:
        """Live until closed; whoever waits for a job then is told that it is over."""
        ended = "the simulated world was closed"
        try:
            self._live_on()
        except SimulationError as error:
            ended = f"the simulated world has ended: {error}"
            _log.error("%s", ended)
        except Exception as error:  # noqa: BLE001 (whoever waits must hear of a bug)
            ended = f"the simulated world has ended: {error!r}"
            _log.exception("%s", ended)
        finally:
            with self._wake:
                self._ended = ended
                for future, _ in self._jobs:
                    future.set_exception(SimulationError(ended))

    def _live_on(self) -> None:
        self._world = self._make_world()
        with self._world:
            while not self._closed:
                if self._jobs:
                    self._still = (self._time, None)  # a job may move anything
                    self._work(*self._jobs.popleft())
                    continue
                if self._lockstep:
                    with self._wake:
                        self._wake.wait_for(lambda: self._jobs or self._closed)
                    continue
                if time.monotonic() < self._pause_end:  # a job came in between
                    self._wait()
                elif self._rests():
                    self._on_steps(PACE_STEPS)
                else:
                    self._world.step(PACE_STEPS)

    def _work(self, future: "Future[Any]", job: Callable[[], Any]) -> None:
        self._working = True
        try:
            future.set_result(job())
        except Exception as error:  # noqa: BLE001 (handed to the caller)
            future.set_exception(error)
        finally:
            self._working = False

    def _rests(self) -> bool:
        """Tell whether nothing has moved for a while, so that only time goes on.

        As fast as possible would be no pace at all then; such a world never rests.
        """
        since, before = self._still
        now = self._places()
        if (
            now is None
            or before is None
            or now.shape != before.shape
            or (np.abs(now - before) > REST_CHANGE).any()
        ):
            self._still = (self._time, now)
            return False
        return self.realtime_factor > 0 and self._time - since > REST_TIME * 1e9

    def _places(self) -> FloatArray | None:
        """Return numbers that stay the same while nothing moves; None if it does."""
        return self.snapshot.poses.ravel()

    def _make_world(self) -> World:
        return _PacedWorld(self._on_steps)

    def _on_steps(self, steps: int) -> None:
        """Advance the clock, take a snapshot, and wait until it is time."""
        if not self._live:
            return
        self._time += steps * STEP_NS
        if self._lockstep:
            return
        self.snapshot = self._look()
        now = time.monotonic()
        start, simulated = self._mark
        if now - start >= 1.0:
            self.measured_factor = (self._time - simulated) / 1e9 / (now - start)
            self._mark = (now, self._time)
        self._pause(now, steps * TIME_STEP)

    def _pause(self, now: float, simulated: float) -> None:
        """Wait until simulated time is due, and always long enough for others to work.

        A world that cannot keep its pace would never let go of the interpreter.
        """
        wait = LEAST_PAUSE * (now - self._resumed)
        if self.realtime_factor > 0:
            self._due = max(self._due, now - LARGEST_LAG)
            self._due += simulated / self.realtime_factor
            wait = max(wait, self._due - now)
        if wait < SHORTEST_WAIT:
            return
        self._pause_end = now + wait
        self._wait()

    def _wait(self) -> None:
        """Wait until the pause ends or a job comes; a job itself keeps the pace."""
        with self._wake:
            self._wake.wait_for(
                lambda: self._closed or (self._jobs and not self._working),
                timeout=self._pause_end - time.monotonic(),
            )
        self._resumed = time.monotonic()

    def _look(self) -> Snapshot:
        world = self._world
        bodies = world.object_ids
        models = tuple(world.model(body) for body in bodies)
        poses = np.array([world.pose(body) for body in bodies]).reshape(-1, 4, 4)
        names = tuple(
            f"{model.name}#{body}" for model, body in zip(models, bodies, strict=True)
        )
        return Snapshot(self._time, names, models, poses)

    def _spawn(self, kind: str, seed: int, count: int) -> tuple[str, ...]:
        self._live = False  # building a scene takes no simulated time
        try:
            self._build(kind, seed, count)
            self._last_spawn = (kind, seed, count)
        except Exception:  # the old scene is gone by now
            self._bring_back()
            raise
        finally:
            self._live = True
            self._due = self._resumed = time.monotonic()
            self.snapshot = self._look()
        return self.snapshot.names

    def _bring_back(self) -> None:
        """Build the last good scene again, or the empty one where that fails, too."""
        for scene in dict.fromkeys((self._last_spawn, EMPTY)):
            try:
                self._build(*scene)
            except Exception:  # noqa: BLE001 (the caller hears of the first error)
                _log.exception("the scene %s could not be brought back", scene)
            else:
                self._last_spawn = scene
                return

    def _build(self, kind: str, seed: int, count: int) -> None:
        """Put table, objects and gripper into the world."""
        objects, names = self.scenes.load(kind)
        how = "pile" if kind == "affordance" else kind
        rng = np.random.default_rng(seed)
        build_scene(self._world, how, objects, names, rng, count=count, seed=seed)
        self._hand = SimGripper(self._world, self.gripper)

    def _try_grasp(
        self, T_task_gripper: FloatArray, opening: float, lift_height: float
    ) -> TrialResult:
        rules = VgnRules()
        if lift_height > 0:
            rules = replace(rules, retreat_distance=lift_height)
        config = replace(TRIAL_PRESETS["vgn"], rules=rules)
        world = self._world
        try:
            result = run_trial(world, self._hand, T_task_gripper, opening, config)
            if result.success and result.object_body in world.object_ids:
                world.remove(result.object_body)
        finally:
            self._hand.park()
        world.clear_outside()
        return result
