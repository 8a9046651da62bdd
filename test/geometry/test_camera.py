# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import ConfigError, ShapeError
from neugrasp_ros.geometry.camera import BENCHMARK_INTRINSICS, Intrinsics, deproject

CAMERA = Intrinsics(6, 4, 10.0, 20.0, 2.0, 1.0)


def test_field_of_view_reaches_the_outer_edges_of_the_image():
    camera = Intrinsics.from_hfov(100, 50, np.deg2rad(90))
    left_edge = (-0.5 - camera.cx) / camera.fx
    right_edge = (99.5 - camera.cx) / camera.fx
    assert np.rad2deg(np.arctan(right_edge) - np.arctan(left_edge)) == pytest.approx(90)


def test_scaling_keeps_the_rays_of_the_image_edges():
    half = BENCHMARK_INTRINSICS.scaled(0.5)
    assert (half.width, half.height) == (320, 240)
    full_edge = (-0.5 - BENCHMARK_INTRINSICS.cx) / BENCHMARK_INTRINSICS.fx
    assert (-0.5 - half.cx) / half.fx == pytest.approx(full_edge)


def test_deprojected_points_project_back_to_their_pixels():
    depth = np.random.default_rng(0).uniform(0.5, 2.0, (4, 6)).astype(np.float32)
    x, y, z = np.moveaxis(deproject(depth, CAMERA), -1, 0)
    rows, columns = np.mgrid[:4, :6]
    np.testing.assert_allclose(CAMERA.fx * x / z + CAMERA.cx, columns, atol=1e-6)
    np.testing.assert_allclose(CAMERA.fy * y / z + CAMERA.cy, rows, atol=1e-6)
    np.testing.assert_allclose(z, depth)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, np.inf, -np.inf])
def test_what_was_not_measured_becomes_nan(bad):
    depth = np.ones((4, 6), dtype=np.float32)
    depth[2, 3] = bad
    points = deproject(depth, CAMERA)
    missing = np.isnan(points).any(axis=-1)
    assert missing[2, 3]
    assert missing.sum() == 1


def test_an_image_of_another_size_is_rejected():
    with pytest.raises(ShapeError, match=r"expected shape \(4, 6\), got \(6, 4\)"):
        deproject(np.ones((6, 4), dtype=np.float32), CAMERA)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ((0, 4, 1.0, 1.0, 0.0, 0.0), "image size 0x4"),
        ((6, 4, 0.0, 1.0, 0.0, 0.0), "focal lengths"),
        ((6, 4, 1.0, np.nan, 0.0, 0.0), "focal lengths"),
    ],
)
def test_a_camera_that_cannot_be_is_rejected(values, told):
    with pytest.raises(ConfigError, match=told):
        Intrinsics(*values)
