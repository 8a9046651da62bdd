# SPDX-License-Identifier: Apache-2.0
import numpy as np

from neugrasp_ros.geometry.grid_skips import GAP_LIMIT, inside_gaps, occupied_blocks


def test_blocks_tell_where_an_inside_value_is_near():
    values = np.full((20, 16, 18), -1.0, dtype=np.float32)
    values[19, 0, 8] = 1.0
    blocks = occupied_blocks(values)
    assert blocks.shape == (3, 2, 3)
    assert np.argwhere(~blocks)[:, 0].tolist() == [0] * 6  # x blocks 1 and 2 are near
    assert blocks[1:].all()


def test_a_gap_is_the_distance_to_the_nearest_cell_that_touches_the_inside():
    values = np.full((40, 17, 17), -1.0, dtype=np.float32)
    values[6, 8, 8] = 1.0  # a corner of the cells 2 and 3 along x, 3 and 4 along y, z
    gaps = inside_gaps(values)
    assert gaps.shape == (20, 9, 9)
    assert (gaps[2:4, 3:5, 3:5] == 0).all()
    assert (gaps == 0).sum() == 8
    assert gaps[:, 4, 4].tolist() == [2, 1, 0, 0, *range(1, 13), 12, 12, 12, 12]
    assert gaps[9, 0, 8] == 6  # the largest of 6, 3 and 4
    assert (inside_gaps(-np.abs(values)) == GAP_LIMIT).all()


def test_a_sample_in_the_middle_of_a_cell_touches_no_other():
    values = np.full((8, 8, 8), -1.0, dtype=np.float32)
    values[3, 5, 1] = 1.0
    assert np.argwhere(inside_gaps(values) == 0).tolist() == [[1, 2, 0]]


def test_gaps_are_the_largest_coordinate_difference_everywhere():
    rng = np.random.default_rng(0)
    values = np.full((30, 22, 26), -1.0, dtype=np.float32)
    values[tuple(rng.integers(0, 22, (3, 5)))] = 1.0
    gaps = inside_gaps(values)
    zero, cells = np.argwhere(gaps == 0), np.argwhere(gaps >= 0)
    truth = np.abs(cells[:, None] - zero).max(axis=2).min(axis=1)
    np.testing.assert_array_equal(gaps.ravel(), np.minimum(truth, GAP_LIMIT))
