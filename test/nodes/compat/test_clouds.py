# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time  # noqa: E402
from sensor_msgs.msg import PointField  # noqa: E402

from neugrasp_ros.errors import ShapeError  # noqa: E402
from neugrasp_ros.nodes.compat.clouds import read_points, write_cloud  # noqa: E402

POINTS = np.random.default_rng(0).normal(size=(7, 3)).astype(np.float32)
STAMP = Time(sec=1, nanosec=2)


def test_points_come_back_and_the_header_is_set():
    cloud = write_cloud(POINTS, "task", STAMP)
    assert (cloud.height, cloud.width, cloud.is_dense) == (1, 7, True)
    assert (cloud.header.frame_id, cloud.header.stamp) == ("task", STAMP)
    np.testing.assert_array_equal(read_points(cloud), POINTS)


def test_normals_are_skipped_by_the_reader():
    cloud = write_cloud(np.hstack([POINTS, -POINTS]), "task", STAMP)
    assert [f.name for f in cloud.fields][3:] == ["normal_x", "normal_y", "normal_z"]
    np.testing.assert_array_equal(read_points(cloud), POINTS)


def test_an_organised_cloud_keeps_its_rows_and_nan():
    grid = np.full((2, 3, 3), np.nan, np.float32)
    grid[0, 0] = 1.0
    cloud = write_cloud(grid, "task", STAMP)
    assert (cloud.height, cloud.width, cloud.is_dense) == (2, 3, False)
    np.testing.assert_array_equal(read_points(cloud), grid.reshape(-1, 3))


def test_a_cloud_of_nothing_is_a_cloud():
    cloud = write_cloud(np.zeros((0, 6)), "task", STAMP)
    assert (cloud.width, len(cloud.data)) == (0, 0)
    assert read_points(cloud).shape == (0, 3)


def test_bad_clouds_are_refused():
    with pytest.raises(ShapeError, match="cloud"):
        write_cloud(np.zeros((4, 2)), "task", STAMP)
    cloud = write_cloud(POINTS, "task", STAMP)
    short = write_cloud(POINTS, "task", STAMP)
    short.data = short.data[:10]
    with pytest.raises(ShapeError, match="data"):
        read_points(short)
    cloud.fields = [PointField(name="x", datatype=PointField.FLOAT64)]
    with pytest.raises(ShapeError, match="fields"):
        read_points(cloud)
