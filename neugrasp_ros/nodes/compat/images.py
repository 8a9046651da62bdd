# SPDX-License-Identifier: Apache-2.0
"""Depth images and masks as messages and arrays (in place of cv_bridge)."""

import sys
from array import array
from collections.abc import Mapping

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image

from neugrasp_ros.errors import ConfigError, DepthImageError
from neugrasp_ros.geometry.camera import Intrinsics

MILLIMETRES = 1000.0  # [1/m]; 16UC1 holds millimetres, 0 = invalid (REP 118)
DEPTH_TYPES = {"32FC1": np.float32, "16UC1": np.uint16, "mono16": np.uint16}
MASK_TYPES = {"mono8": np.uint8, "8UC1": np.uint8}
BIG_ENDIAN_HOST = sys.byteorder == "big"


def to_bytes(values: NDArray) -> array:
    """Return an array's memory as ``array('B')``.

    It is the one form that message fields take without a copy per element.
    """
    data = array("B")
    if values.size:  # a view of nothing cannot be cast
        data.frombytes(np.ascontiguousarray(values).data.cast("B"))
    return data


def read_depth(image: Image) -> NDArray[np.float32]:
    """Return a depth image in [m], shape (H, W).

    Reads 32FC1 (metres) and 16UC1 / mono16 (millimetres, 0 = invalid -> NaN), either
    endianness, padded rows. Invalid pixels of 32FC1 are left as they are.

    Raises:
        DepthImageError: If the encoding is another one or the data are too short.
    """
    raw = _read(image, DEPTH_TYPES)
    if raw.dtype == np.float32:
        return raw
    depth = raw.astype(np.float32) / np.float32(MILLIMETRES)
    depth[raw == 0] = np.nan
    return depth


def read_mask(image: Image) -> NDArray[np.bool_]:
    """Return a mono8 mask, shape (H, W); True where it is not zero.

    Raises:
        DepthImageError: If the encoding is another one or the data are too short.
    """
    return np.asarray(_read(image, MASK_TYPES) != 0)


def _read(image: Image, types: Mapping[str, type]) -> NDArray:
    if image.encoding not in types:
        raise DepthImageError(
            f"image encoding {image.encoding!r}; expected one of {', '.join(types)}"
        )
    swapped = bool(image.is_bigendian) != BIG_ENDIAN_HOST
    dtype = np.dtype(types[image.encoding])
    row = image.width * dtype.itemsize
    step = image.step or row
    if image.width < 1 or image.height < 1 or step < row:
        raise DepthImageError(
            f"a {image.width}x{image.height} {image.encoding} image cannot have rows "
            f"of {step} bytes"
        )
    needed = step * (image.height - 1) + row
    if len(image.data) < needed:
        raise DepthImageError(
            f"a {image.width}x{image.height} {image.encoding} image needs {needed} "
            f"bytes, got {len(image.data)}"
        )
    flat = np.frombuffer(image.data, np.uint8)
    if len(flat) < step * image.height:  # the last row may lack its padding
        flat = np.concatenate([flat, np.zeros(step * image.height - len(flat), "u1")])
    rows = flat[: step * image.height].reshape(image.height, step)
    pixels = np.ascontiguousarray(rows[:, :row]).view(dtype)
    return pixels.byteswap() if swapped else pixels.copy()


def write_depth(
    depth: NDArray[np.float32], encoding: str, frame_id: str, stamp: Time
) -> Image:
    """Return a depth image in [m], shape (H, W), as a message.

    Args:
        depth: The image; anything not finite or not positive becomes 0 in 16UC1.
        encoding: ``32FC1`` or ``16UC1``.
        frame_id: The camera's optical frame.
        stamp: When it was taken.

    Raises:
        DepthImageError: If the encoding is another one.
    """
    if encoding == "32FC1":
        pixels: NDArray = np.asarray(depth, dtype=np.float32)
    elif encoding == "16UC1":
        valid = np.isfinite(depth) & (depth > 0)
        millimetres = np.rint(np.where(valid, depth, 0.0) * MILLIMETRES)
        pixels = np.where(millimetres <= 0xFFFF, millimetres, 0).astype(np.uint16)
    else:
        raise DepthImageError(f"encoding {encoding!r}; expected 32FC1 or 16UC1")
    return _write(pixels, encoding, frame_id, stamp)


def write_color(pixels: NDArray[np.uint8], frame_id: str, stamp: Time) -> Image:
    """Return a picture of shape (H, W, 3), red first, as an ``rgb8`` message."""
    height, width, _ = pixels.shape
    image = Image(height=height, width=width, encoding="rgb8", step=3 * width)
    image.header.frame_id, image.header.stamp = frame_id, stamp
    image.data = to_bytes(pixels)
    return image


def read_color(image: Image) -> NDArray[np.uint8]:
    """Return an ``rgb8`` message as a picture of shape (H, W, 3).

    Raises:
        DepthImageError: If it has another encoding.
    """
    if image.encoding != "rgb8":
        raise DepthImageError(f"expected encoding rgb8, got {image.encoding!r}")
    rows = np.frombuffer(image.data, dtype=np.uint8).reshape(image.height, image.step)
    return rows[:, : 3 * image.width].reshape(image.height, image.width, 3)


def write_labels(
    labels: NDArray[np.integer], encoding: str, frame_id: str, stamp: Time
) -> Image:
    """Return an image of labels, shape (H, W), as mono8 or mono16."""
    types = {"mono8": np.uint8, "mono16": np.uint16}
    return _write(labels.astype(types[encoding]), encoding, frame_id, stamp)


def _write(pixels: NDArray, encoding: str, frame_id: str, stamp: Time) -> Image:
    image = Image(height=pixels.shape[0], width=pixels.shape[1], encoding=encoding)
    image.header.frame_id = frame_id
    image.header.stamp = stamp
    image.is_bigendian = int(BIG_ENDIAN_HOST)
    image.step = pixels.shape[1] * pixels.itemsize
    image.data = to_bytes(pixels)
    return image


def read_intrinsics(info: CameraInfo) -> Intrinsics:
    """Return the intrinsics of a rectified image: of P, or of K where P is zero.

    Raises:
        ConfigError: If the camera is not calibrated (focal length 0) or has no size.
    """
    matrix = info.p if info.p[0] > 0 else info.k
    fy, cy = (matrix[5], matrix[6]) if matrix is info.p else (matrix[4], matrix[5])
    if not matrix[0] > 0:
        raise ConfigError(f"the camera is not calibrated: K[0] is {info.k[0]}")
    return Intrinsics(info.width, info.height, matrix[0], fy, matrix[2], cy)


def write_intrinsics(intrinsics: Intrinsics, frame_id: str, stamp: Time) -> CameraInfo:
    """Return a camera without distortion as a message."""
    fx, fy, cx, cy = intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy
    info = CameraInfo(height=intrinsics.height, width=intrinsics.width)
    info.header.frame_id = frame_id
    info.header.stamp = stamp
    info.distortion_model = "plumb_bob"
    info.d = [0.0] * 5
    info.k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    return info
