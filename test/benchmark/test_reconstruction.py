# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.benchmark.reconstruction import field_iou
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import translation

SUPPORT = 0.05  # [m]


def box_field(lower, upper, resolution=60):
    axis = (np.arange(resolution) + 0.5) * 0.3 / resolution
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    inside = ((points > lower) & (points < upper)).all(axis=-1)
    return ScalarGrid(np.where(inside, 5.0, -5.0).astype(np.float32), 0.3 / resolution)


@pytest.fixture
def box():
    """From 0.1 to 0.2 m in x and y, from the support up by 0.1 m."""
    center = translation(0.15, 0.15, 0.1)
    return MeshScene([box_mesh(np.full(3, 0.05))], center[None])


def test_the_box_itself_fits_and_half_of_it_is_half(box):
    assert field_iou(box_field([0.1, 0.1, 0.05], [0.2, 0.2, 0.15]), box, SUPPORT) == 1.0
    half = box_field([0.1, 0.1, 0.05], [0.15, 0.2, 0.15])
    assert field_iou(half, box, SUPPORT) == pytest.approx(0.5)
    moved = box_field([0.15, 0.1, 0.05], [0.25, 0.2, 0.15])
    assert field_iou(moved, box, SUPPORT) == pytest.approx(1 / 3)


def test_what_lies_below_the_support_does_not_count(box):
    deeper = box_field([0.1, 0.1, 0.0], [0.2, 0.2, 0.15])
    assert field_iou(deeper, box, SUPPORT) == 1.0


def test_nothing_in_nothing_has_no_ratio(box):
    empty = ScalarGrid(np.full((30, 30, 30), -5.0, dtype=np.float32), 0.01)
    assert field_iou(empty, box, SUPPORT) == 0.0
    far = MeshScene([box_mesh(np.full(3, 0.05))], translation(9.0, 9.0, 9.0)[None])
    assert field_iou(empty, far, SUPPORT) is None
