# SPDX-License-Identifier: Apache-2.0
import re
import threading
import time

import numpy as np
import pytest

from neugrasp_ros.errors import SimulationError, UnknownNameError
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import make_transform
from sim_bridge import bridge_world
from sim_bridge.bridge_world import LEAST_PAUSE, BridgeScenes, BridgeWorld

pytestmark = pytest.mark.filterwarnings("ignore:Gimbal lock")

DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def world():
    world = BridgeWorld(load_gripper("robotiq_2f85"), BridgeScenes(), 0.0)
    yield world
    world.close()


def later(world, seconds: float):
    """Wait until simulated time has gone on; return the snapshot then."""
    target = world.snapshot.time + int(seconds * 1e9)
    deadline = time.monotonic() + 60
    while world.snapshot.time < target:
        assert time.monotonic() < deadline
        time.sleep(0.005)
    return world.snapshot


def test_the_same_seed_gives_the_same_scene(world):
    names = world.spawn("packed", 4, 3)
    poses = world.snapshot.poses
    world.spawn("packed", 5, 3)
    assert world.spawn("packed", 4, 3) == names
    np.testing.assert_allclose(world.snapshot.poses, poses, atol=2e-3)
    assert world.reset() == names


def test_time_goes_on_across_scenes_and_objects_stay_on_the_table(world):
    before = world.snapshot.time
    world.spawn("pile", 1, 3)
    start = world.snapshot
    assert start.time >= before
    end = later(world, 0.5)
    assert end.time > start.time and len(end.names) == len(start.names) > 0
    assert np.abs(end.poses[:, :3, 3] - start.poses[:, :3, 3]).max() < 0.02


def test_what_cannot_be_spawned_or_tried_is_refused_and_life_goes_on(world):
    with pytest.raises(UnknownNameError, match="known: affordance, egad"):
        world.spawn("circus", 0, 3)
    with pytest.raises(SimulationError, match="opening must be within"):
        world.try_grasp(make_transform(DOWN, np.array([0.15, 0.15, 0.2])), 0.5, 0.0)
    later(world, 0.1)


@pytest.fixture
def broken(monkeypatch):
    """Seeds whose scenes break when the one before is gone already."""
    seeds, build_scene = set(), bridge_world.build_scene

    def build(world, *scene, seed, **options):
        world.reset()
        if seed in seeds:
            raise ValueError(f"broken mesh of seed {seed}")
        return build_scene(world, *scene, seed=seed, **options)

    monkeypatch.setattr(bridge_world, "build_scene", build)
    return seeds


def test_after_a_scene_that_broke_half_way_the_last_good_one_is_back(world, broken):
    names = world.spawn("packed", 4, 3)
    poses = world.snapshot.poses
    broken.add(9)
    with pytest.raises(ValueError, match="broken mesh of seed 9"):
        world.spawn("pile", 9, 3)
    assert world.snapshot.names == names
    np.testing.assert_allclose(world.snapshot.poses, poses, atol=2e-3)
    air = make_transform(DOWN, np.array([0.15, 0.15, 0.4]))
    assert world.try_grasp(air, 0.08, 0.05).reason == "empty", "the hand is back"
    assert world.reset() == names


def test_where_the_last_good_scene_breaks_too_the_table_is_empty(world, broken):
    world.spawn("packed", 4, 3)
    broken.update((4, 9))
    with pytest.raises(ValueError, match="broken mesh of seed 9"):
        world.spawn("pile", 9, 3)
    later(world, 0.1)
    assert world.snapshot.names == () and world.reset() == ()


def test_closing_on_nothing_lifts_nothing(world):
    world.spawn("empty", 0, 0)
    result = world.try_grasp(
        make_transform(DOWN, np.array([0.15, 0.15, 0.15])), 0.08, 0.05
    )
    assert not result.success and result.reason == "empty"


def test_the_hand_is_parked_after_a_trial_that_breaks(world, monkeypatch):
    world.spawn("empty", 0, 0)
    low = make_transform(DOWN, np.array([0.15, 0.15, 0.2]))

    def break_down(_, hand, T_world_gripper, opening, config):
        hand.teleport(T_world_gripper, opening)
        raise OverflowError("on the way")

    with monkeypatch.context() as patch:
        patch.setattr(bridge_world, "run_trial", break_down)
        with pytest.raises(OverflowError, match="on the way"):
            world.try_grasp(low, 0.08, 0.05)
    lower, _ = world.do(lambda: world._world.bounds(world._hand.body)).result()
    assert lower[2] > 1.0


def test_a_lifted_object_is_taken_away(world):
    for seed in range(6):
        world.spawn("packed", seed, 1)
        pose = world.snapshot.poses[0]
        bounds = np.array(
            [m.transformed(pose).bounds() for m in world.snapshot.models[0].visuals]
        )
        lower, upper = bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
        extent = upper - lower
        narrow = int(np.argmin(extent[:2]))
        if extent[narrow] > 0.07:
            continue
        closing = np.eye(3)[narrow]
        rotation = np.stack([np.cross(closing, [0, 0, -1.0]), closing, [0, 0, -1.0]], 1)
        middle = (lower + upper) / 2
        middle[2] = max(upper[2] - 0.03, 0.06)
        result = world.try_grasp(make_transform(rotation, middle), 0.085, 0.1)
        if result.success:
            assert result.width > 0.005 and not world.snapshot.names
            return
    raise AssertionError("no seed of six gave an object that stands to be lifted")


def test_real_time_is_kept():
    world = BridgeWorld(load_gripper("robotiq_2f85"), BridgeScenes(), 2.0)
    try:
        start, began = world.snapshot.time, time.monotonic()
        later(world, 1.0)
        wall = time.monotonic() - began
        simulated = (world.snapshot.time - start) / 1e9
        assert simulated / wall < 2.2
    finally:
        world.close()


def test_a_world_that_is_closed_refuses_jobs_and_leaves_nobody_waiting():
    world = BridgeWorld(load_gripper("panda"), BridgeScenes(), 0.0)
    begun = threading.Event()
    working = world.do(lambda: (begun.set(), time.sleep(0.3)))
    assert begun.wait(10.0)
    waiting = world.do(lambda: None)
    closing = threading.Thread(target=world.close)
    closing.start()
    while not world._closed:
        time.sleep(0.001)
    working.result(10.0)
    with pytest.raises(SimulationError, match="world was closed"):
        waiting.result(10.0)
    closing.join()
    with pytest.raises(SimulationError, match="world was closed"):
        world.spawn("empty", 0, 0)


class Dying(BridgeWorld):
    breaks: Exception | None = None

    def _on_steps(self, steps):
        super()._on_steps(steps)
        if self.breaks:
            raise self.breaks


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (SimulationError("engine lost"), "has ended: engine lost"),
        (ValueError("a bug"), r"has ended: ValueError\('a bug'\)"),
    ],
)
def test_a_world_that_dies_while_it_runs_says_why(error, reason, caplog, monkeypatch):
    monkeypatch.setattr(bridge_world._log, "handlers", [caplog.handler])
    world = Dying(load_gripper("panda"), BridgeScenes(), 0.0)
    assert not world.ended
    world.breaks = error
    world._thread.join(60.0)
    assert re.search(reason, world.ended) and world.ended in caplog.text
    with pytest.raises(SimulationError, match=reason):
        world.spawn("empty", 0, 0)


class NoEngine(BridgeWorld):
    def _make_world(self):
        raise SimulationError("no engine")


def test_a_world_whose_engine_does_not_start_says_so():
    with pytest.raises(SimulationError, match="has ended: no engine"):
        NoEngine(load_gripper("panda"), BridgeScenes(), 0.0)


class Steps:
    """Counts the engine's steps of a world."""

    def __init__(self, world) -> None:
        self.count, self._step = 0, world.step
        world.step = self.step

    def step(self, count=1):
        self.count += count
        self._step(count)


def test_of_a_world_at_rest_only_the_time_goes_on():
    world = BridgeWorld(load_gripper("robotiq_2f85"), BridgeScenes(), 20.0)
    try:
        world.spawn("packed", 4, 2)
        later(world, 2.0)
        steps = Steps(world._world)
        start = world.snapshot
        end = later(world, 1.0)
        assert steps.count == 0
        np.testing.assert_array_equal(end.poses, start.poses)
        (body, *_) = world._world.object_ids
        T = start.poses[0].copy()
        T[2, 3] += 0.05
        world.do(lambda: world._world.set_pose(body, T)).result()
        fallen = later(world, 1.0)
        assert steps.count > 50
        assert fallen.poses[0, 2, 3] == pytest.approx(start.poses[0, 2, 3], abs=5e-3)
    finally:
        world.close()


class Clock:
    """A clock and a condition that nobody notifies: waiting takes the whole time."""

    def __init__(self) -> None:
        self.now, self.waits, self.conditions = 0.0, [], []

    def monotonic(self) -> float:
        return self.now

    def wait_for(self, condition, timeout):
        self.waits.append(timeout)
        self.conditions.append(condition)
        self.now += timeout

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def stopped(clock):
    """A world whose thread does nothing, at the clock's zero; its pauses are asked."""
    world = BridgeWorld(load_gripper("panda"), BridgeScenes(), lockstep=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(world, "_wake", clock)
        patch.setattr(bridge_world, "time", clock)
        patch.setattr(world, "_due", 0.0)
        patch.setattr(world, "_resumed", 0.0)
        yield world
    world.close()


@pytest.mark.parametrize("factor", [0.0, 1000.0])
def test_a_world_that_is_too_slow_lets_others_work(stopped, clock, factor):
    stopped.realtime_factor = factor
    for _ in range(3):
        clock.now += 0.4  # of physics
        stopped._pause(clock.now, 1 / 60)
    np.testing.assert_allclose(clock.waits, LEAST_PAUSE * 0.4)


def test_a_world_that_is_fast_waits_until_its_time_is_due(stopped, clock):
    stopped.realtime_factor = 0.5
    for _ in range(3):
        clock.now += 0.01
        stopped._pause(clock.now, 0.1)
    assert clock.now == pytest.approx(3 * 0.1 / 0.5)


def test_the_steps_of_a_job_keep_their_pace_though_others_wait(stopped, clock):
    stopped._pause(0.0, 1 / 60)
    (wakes,) = clock.conditions
    assert not wakes()
    stopped._jobs.append((None, None))
    assert wakes()
    stopped._working = True
    assert not wakes()
    stopped._working = False
    stopped._jobs.clear()


def test_jobs_do_not_wait_for_a_pause_and_let_no_time_pass():
    world = BridgeWorld(load_gripper("panda"), BridgeScenes(), 1e-4)
    try:
        deadline = time.monotonic() + 60
        while not world.snapshot.time:  # the pause after the first steps takes minutes
            assert time.monotonic() < deadline
            time.sleep(0.001)
        start = world.snapshot.time
        assert [world.do(lambda: 7).result(20.0) for _ in range(5)] == [7] * 5
        assert world.snapshot.time == start
    finally:
        world.close()
