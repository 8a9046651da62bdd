# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.grid_refine import doubled, straddling


def centers(shape: tuple[int, ...]) -> np.ndarray:
    axes = [(np.arange(n) + 0.5) / n for n in shape]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def test_a_linear_field_is_doubled_exactly_but_for_its_border():
    slope = np.array([1.0, -2.0, 3.0])
    values = (centers((6, 8, 10)) @ slope).astype(np.float32)
    truth = centers((12, 16, 20)) @ slope
    fine = doubled(values)
    inner = (slice(1, -1),) * 3
    np.testing.assert_allclose(fine[inner], truth[inner], atol=1e-6)
    assert fine[0, 0, 0] == values[0, 0, 0]
    assert fine[-1, -1, -1] == values[-1, -1, -1]


def test_threads_double_the_same():
    values = np.random.default_rng(0).normal(size=(40, 5, 6)).astype(np.float32)
    np.testing.assert_array_equal(doubled(values), doubled(values, threads=3))


@pytest.mark.parametrize("margin", [0.0, 0.4])
def test_straddling_samples_are_those_between_unlike_corners(margin):
    values = np.random.default_rng(1).normal(size=(5, 6, 7)).astype(np.float32)
    values[:3] -= 3.0
    expected = set()
    padded = np.pad(values, 1, mode="edge")
    for i, j, k in np.ndindex(10, 12, 14):
        a, b, c = (i + 1) // 2, (j + 1) // 2, (k + 1) // 2
        corners = padded[a : a + 2, b : b + 2, c : c + 2]
        if corners.max() > -margin and corners.min() < margin:
            expected.add((i, j, k))
    found = straddling(values, margin)
    assert {tuple(row) for row in found.tolist()} == expected
    assert len(found) == len(expected)
    assert 0 < len(expected) < 10 * 12 * 14


def test_nothing_straddles_where_all_agree():
    assert straddling(np.full((4, 4, 4), -2.0, np.float32), 1.0).shape == (0, 3)
    assert straddling(np.full((2, 2, 2), -2.0, np.float32), 3.0).shape == (64, 3)
