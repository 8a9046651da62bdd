# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.training.stretching import (
    FACTORS,
    Stretch,
    draw_stretch,
    stretched_points,
    stretched_volume,
)
from neugrasp_ros.training.views import EDGE, TABLE_TOP, UNKNOWN

SIZE = 32


def ball(center: np.ndarray, reach: float) -> np.ndarray:
    axis = (np.arange(SIZE) + 0.5) / SIZE
    cells = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    near = np.linalg.norm(cells - center, axis=-1) < reach
    return np.where(near, -60, 127).astype(np.int8)


@pytest.mark.parametrize("seed", range(6))
def test_points_go_where_their_voxels_go(seed):
    stretch = draw_stretch(np.random.default_rng(seed))
    center = np.array([[0.45, 0.6, 0.4]], dtype=np.float32)
    there = stretched_volume(ball(center[0], 0.12), stretch)
    found = (np.argwhere(there == -60) + 0.5).mean(axis=0) / SIZE
    expected = stretched_points(center, stretch)[0]
    np.testing.assert_allclose(found, expected, atol=0.6 / SIZE)


def test_things_grow_by_the_factor_and_the_table_stays():
    volume = ball(np.array([0.5, 0.5, 0.5]), 0.2)
    stretch = Stretch(np.diag([1.25, 1.0]), np.zeros(2), 0.8)
    counts = [np.sum(v == -60) for v in (volume, stretched_volume(volume, stretch))]
    assert counts[1] == pytest.approx(counts[0] * 1.25 * 0.8, rel=0.05)
    table = np.array([[0.1, 0.9, TABLE_TOP / EDGE]], dtype=np.float32)
    assert stretched_points(table, stretch)[0, 2] == table[0, 2]


def test_what_comes_in_was_never_observed():
    stretch = Stretch(np.eye(2), np.array([0.25, 0.0]), 1.0)
    there = stretched_volume(np.full((SIZE,) * 3, 9, dtype=np.int8), stretch)
    assert (there[: SIZE // 4] == UNKNOWN).all()
    assert (there[SIZE // 4 :] == 9).all()
    flat = Stretch(np.eye(2), np.zeros(2), 0.8)
    there = stretched_volume(np.full((SIZE,) * 3, 9, dtype=np.int8), flat)
    top = round(SIZE * (0.8 + 0.2 * TABLE_TOP / EDGE))
    assert (there[..., top:] == UNKNOWN).all()
    assert (there[..., SIZE // 4 : top - 1] == 9).all()


def test_no_stretch_is_beyond_its_limits():
    rng = np.random.default_rng(0)
    for _ in range(200):
        drawn = draw_stretch(rng)
        factors = [*np.linalg.svd(drawn.matrix)[1], drawn.height]
        assert FACTORS[0] - 1e-9 <= min(factors) <= max(factors) <= FACTORS[1] + 1e-9
