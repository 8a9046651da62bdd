# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.fusion.support_plane import find_workspace


@pytest.fixture
def table() -> np.ndarray:
    """A table top of 1.4 x 0.9 m at z = 0.7 m, measured to 2 mm."""
    rng = np.random.default_rng(0)
    points = rng.uniform([0.4, -0.7, 0.7], [1.3, 0.7, 0.7], (20000, 3))
    points[:, 2] += rng.normal(0, 0.002, len(points))
    return points


def boxes(rng: np.random.Generator, *centers: tuple[float, float]) -> np.ndarray:
    """Points of boxes of 6 x 6 x 12 cm that stand on the table."""
    half = [0.03, 0.03, 0.06]
    return np.concatenate(
        [rng.uniform(-1, 1, (600, 3)) * half + [*c, 0.76] for c in centers]
    )


def test_the_box_holds_what_stands_on_the_table(table):
    things = boxes(np.random.default_rng(1), (0.7, -0.2), (1.0, 0.3))
    found = find_workspace(np.concatenate([table, things]))
    assert found.support == pytest.approx(0.7, abs=0.003)
    assert found.origin[2] == pytest.approx(found.support - 0.05)
    assert (things > found.origin + 0.03).all()
    assert (things < found.origin + found.size - 0.03).all()
    np.testing.assert_allclose(found.size[:2], [0.52, 0.72], atol=0.02)
    assert (found.size >= 0.3 - 1e-9).all()


def test_a_larger_wall_is_not_the_support(table):
    rng = np.random.default_rng(2)
    wall = rng.uniform([1.5, -2, 0], [1.5, 2, 2.5], (60000, 3))
    things = boxes(rng, (0.8, 0.0))
    found = find_workspace(np.concatenate([wall, table, things]))
    assert found.support == pytest.approx(0.7, abs=0.003)
    middle = found.origin + found.size / 2
    np.testing.assert_allclose(middle[:2], [0.8, 0.0], atol=0.02)


def test_an_empty_table_gives_its_middle(table):
    found = find_workspace(table)
    middle = found.origin + found.size / 2
    np.testing.assert_allclose(middle[:2], [0.85, 0.0], atol=0.03)
    np.testing.assert_allclose(found.size, 0.3)


def test_unmeasured_points_do_not_count_and_input_is_left_alone(table):
    things = boxes(np.random.default_rng(3), (0.7, 0.1))
    points = np.concatenate([table, things, np.full((50, 3), np.nan)])
    before = points.copy()
    found = find_workspace(points)
    np.testing.assert_array_equal(points, before)
    assert np.isfinite(found.origin).all()


def test_without_a_level_plane_there_is_no_workspace():
    rng = np.random.default_rng(4)
    wall = rng.uniform([1.5, -2, 0], [1.5, 2, 2.5], (20000, 3))
    with pytest.raises(EmptySceneError, match="no level plane"):
        find_workspace(wall)
