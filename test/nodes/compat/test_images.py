# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("rclpy")

from builtin_interfaces.msg import Time  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image  # noqa: E402

from neugrasp_ros.errors import ConfigError, DepthImageError  # noqa: E402
from neugrasp_ros.geometry.camera import Intrinsics  # noqa: E402
from neugrasp_ros.nodes.compat.images import (  # noqa: E402
    read_depth,
    read_intrinsics,
    read_mask,
    to_bytes,
    write_depth,
    write_intrinsics,
    write_labels,
)

STAMP = Time(sec=3, nanosec=7)


def sample() -> np.ndarray:
    depth = np.linspace(0.3, 2.9, 12, dtype=np.float32).reshape(3, 4)
    depth[0, 1], depth[1, 2] = np.nan, np.inf
    return depth


def test_float_metres_come_back_bit_for_bit():
    depth = sample()
    image = write_depth(depth, "32FC1", "camera", STAMP)
    assert (image.header.frame_id, image.header.stamp) == ("camera", STAMP)
    assert (image.height, image.width, image.step) == (3, 4, 16)
    np.testing.assert_array_equal(read_depth(image), depth)


def test_millimetres_come_back_within_half_of_one():
    depth = sample()
    back = read_depth(write_depth(depth, "16UC1", "camera", STAMP))
    valid = np.isfinite(depth)
    np.testing.assert_allclose(back[valid], depth[valid], atol=5.01e-4)
    assert np.isnan(back[~valid]).all()


@pytest.mark.parametrize("encoding", ["32FC1", "16UC1"])
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 5])
def test_endianness_and_padded_rows_do_not_matter(encoding, big, padding):
    depth = np.array([[0.5, 1.25], [0.0, 2.5]], dtype=np.float32)
    pixels = depth if encoding == "32FC1" else (depth * 1000).astype(np.uint16)
    wire = pixels.astype(pixels.dtype.newbyteorder(">" if big else "<"))
    rows = wire.view(np.uint8).reshape(2, -1)
    rows = np.hstack([rows, np.full((2, padding), 0xAB, np.uint8)])
    image = Image(height=2, width=2, encoding=encoding, is_bigendian=int(big))
    image.step, image.data = rows.shape[1], to_bytes(rows)
    expected = depth.copy()
    if encoding == "16UC1":
        expected[depth == 0] = np.nan
    np.testing.assert_allclose(read_depth(image), expected, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"encoding": "rgb8"}, "encoding 'rgb8'; expected one of 32FC1, 16UC1"),
        ({"height": 9}, "needs 144 bytes, got 48"),
        ({"step": 3}, "cannot have rows of 3 bytes"),
        ({"width": 0}, "0x3"),
    ],
)
def test_an_impossible_image_is_refused(change, sentence):
    image = write_depth(sample(), "32FC1", "camera", STAMP)
    for name, value in change.items():
        setattr(image, name, value)
    with pytest.raises(DepthImageError, match=sentence):
        read_depth(image)


def test_an_unknown_encoding_cannot_be_written():
    with pytest.raises(DepthImageError, match="32FC1 or 16UC1"):
        write_depth(sample(), "64FC1", "camera", STAMP)


def test_masks_and_labels():
    labels = np.array([[0, 1], [2, 300]])
    mask = read_mask(write_labels(labels % 256, "mono8", "camera", STAMP))
    np.testing.assert_array_equal(mask, [[False, True], [True, True]])
    assert write_labels(labels, "mono16", "camera", STAMP).step == 4


def test_intrinsics_round_trip_and_projection_matrix_wins():
    camera = Intrinsics(640, 480, 522.2, 521.0, 319.5, 239.5)
    info = write_intrinsics(camera, "camera", STAMP)
    assert read_intrinsics(info) == camera
    info.k[0] = 9.0
    assert read_intrinsics(info) == camera
    info.p = [0.0] * 12
    assert read_intrinsics(info).fx == 9.0


def test_an_uncalibrated_camera_is_refused():
    with pytest.raises(ConfigError, match="not calibrated"):
        read_intrinsics(CameraInfo(width=640, height=480))
