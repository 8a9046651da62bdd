# SPDX-License-Identifier: Apache-2.0
import numpy as np
from sim_shapes import looking_down

from sim_bridge.paths import shake_path, straight_path, tilt_path

START = looking_down(0.1, 0.2, 0.3)
TICK = 1.0 / 240.0


def test_a_straight_path_is_evenly_spaced_and_ends_at_its_target():
    target = START[:3, 3] + [0.0, 0.0, -0.05]
    path = np.array(list(straight_path(START, target, 0.002)))
    assert len(path) == 25
    np.testing.assert_allclose(path[-1][:3, 3], target)
    np.testing.assert_allclose(np.diff(path[:, 2, 3]), -0.002)
    np.testing.assert_array_equal(path[:, :3, :3], [START[:3, :3]] * 25)


def test_a_shake_swings_by_its_amplitude_and_comes_back():
    path = shake_path(
        START,
        np.array([1.0, 0.0, 0.0]),
        amplitude=0.02,
        frequency=2.0,
        duration=1.0,
        time_step=TICK,
    )
    offsets = np.array([pose[:3, 3] for pose in path]) - START[:3, 3]
    assert len(offsets) == 240
    np.testing.assert_allclose(np.abs(offsets).max(axis=0), [0.02, 0, 0], atol=1e-9)
    np.testing.assert_allclose(offsets[-1], 0.0, atol=1e-9)


def test_a_tilt_swings_to_both_sides_about_the_origin_and_comes_back():
    axis = np.array([0.0, 1.0, 0.0])
    path = list(tilt_path(START, axis, angle=0.3, duration=1.0, time_step=TICK))
    np.testing.assert_allclose([p[:3, 3] for p in path], [START[:3, 3]] * len(path))
    turns = [
        np.arccos((np.trace(p[:3, :3] @ START[:3, :3].T) - 1) / 2) for p in path[:-1]
    ]
    assert abs(max(turns) - 0.3) < 1e-3
    np.testing.assert_allclose(path[-1], START, atol=1e-9)
    quarter, three_quarters = path[59][:3, 2], path[179][:3, 2]
    assert quarter[0] * three_quarters[0] < 0
