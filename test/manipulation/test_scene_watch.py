# SPDX-License-Identifier: Apache-2.0
import threading

import numpy as np
import pytest

from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.manipulation.scene_watch import KEPT, SET_BACK, SceneWatch, SeenScene

VOXEL, TRUNCATION = 0.3 / 64, 4 * 0.3 / 64
T_BASE_TASK = translation(0.4, -0.15, 0.65)
SUPPORT = 0.05
CENTERS = (np.stack(np.indices((64, 64, 64)), axis=-1) + 0.5) * VOXEL


def box_scene(middle, revision, hidden=False):
    """A 5 cm cube on the support, as distances that a perfect sensor would fuse."""
    half = np.array([0.025, 0.025, 0.025])
    lower = np.array([*middle, SUPPORT + 0.025])
    d = np.abs(CENTERS - lower) - half
    outside = np.linalg.norm(np.maximum(d, 0), axis=-1)
    box = outside + np.minimum(d.max(axis=-1), 0)
    distance = np.minimum(box, CENTERS[..., 2] - SUPPORT) / TRUNCATION
    values = np.clip(distance, -1, 1).astype(np.float32)
    if hidden:
        values[:] = np.nan
    volume = TsdfVolume(values, np.ones((64,) * 3, np.uint8), VOXEL, TRUNCATION, 1)
    return SeenScene(volume, T_BASE_TASK, revision, 100 * revision)


def grasp(middle):
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[:3, 3] = (T_BASE_TASK @ [*middle, SUPPORT + 0.03, 1.0])[:3]
    return T


HERE = (0.15, 0.15)


@pytest.mark.parametrize(("shift", "moved"), [(0.0, False), (0.002, False),
                                              (0.025, True), (0.06, True)])  # fmt: skip
def test_only_a_shift_of_centimetres_counts(shift, moved):
    watch, then = SceneWatch(SUPPORT), box_scene(HERE, 1)
    watch.remember(then)
    assert not watch.has_moved(grasp(HERE), then), "nothing newer was seen"
    watch.remember(box_scene((HERE[0] + shift, HERE[1]), 2))
    assert watch.has_moved(grasp(HERE), then) == moved


def test_what_is_hidden_has_not_moved():
    watch, then = SceneWatch(SUPPORT), box_scene(HERE, 1)
    watch.remember(then)
    watch.remember(box_scene(HERE, 2, hidden=True))
    assert not watch.has_moved(grasp(HERE), then)


def test_another_object_may_move():
    watch, then = SceneWatch(SUPPORT), box_scene(HERE, 1)
    watch.remember(then)
    watch.remember(box_scene((0.25, 0.25), 2))
    assert not watch.has_moved(grasp((0.05, 0.05)), then)


def test_scenes_are_found_by_number_and_by_time_and_forgotten():
    watch = SceneWatch(SUPPORT)
    assert watch.newest is None
    assert watch.points().shape == (0, 3)
    scenes = [box_scene(HERE, k) for k in range(1, KEPT + 2)]
    for scene in scenes:
        watch.remember(scene)
    assert watch.get(1) is None
    assert watch.get(2) is scenes[1]
    assert watch.before(350) is scenes[2]
    assert watch.before(50) is None
    points = watch.points()
    assert points[:, 2].min() == pytest.approx(0.70, abs=1e-6)
    assert points[:, 2].max() == pytest.approx(0.75, abs=2e-3)


def test_a_scene_that_is_seen_again_keeps_the_time_when_it_was_first_seen():
    watch, first = SceneWatch(SUPPORT), box_scene(HERE, 1)
    watch.remember(first)
    watch.remember(first._replace(stamp=500))
    assert watch.newest.stamp == 500
    assert watch.before(first.stamp).revision == 1
    assert watch.before(first.stamp - 1) is None


def test_a_scene_that_comes_late_is_passed_over():
    watch, later = SceneWatch(SUPPORT), box_scene(HERE, 2)
    watch.remember(later)
    watch.remember(box_scene(HERE, 1))
    assert watch.newest is later
    assert watch.get(1) is None


def test_a_clock_that_was_set_back_begins_anew():
    watch, first = SceneWatch(SUPPORT), box_scene(HERE, 1)
    watch.remember(first._replace(revision=7, stamp=first.stamp + SET_BACK + 1))
    watch.remember(first)
    assert watch.newest is first
    assert watch.get(7) is None


def test_threads_may_remember_and_ask_at_the_same_time():
    watch, first = SceneWatch(SUPPORT), box_scene(HERE, 1)
    watch.remember(first)
    done, failed = threading.Event(), []

    def ask():
        while not done.is_set():
            try:
                watch.before(10**9), watch.newest
            except Exception as error:
                failed.append(error)
                return

    threads = [threading.Thread(target=ask) for _ in range(3)]
    for thread in threads:
        thread.start()
    for k in range(2, 20000):
        watch.remember(first._replace(revision=k, stamp=100 * k))
    done.set()
    for thread in threads:
        thread.join()
    assert not failed
    assert watch.newest.revision == 19999
