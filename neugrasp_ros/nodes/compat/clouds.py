# SPDX-License-Identifier: Apache-2.0
"""Point clouds as messages and arrays (in place of sensor_msgs_py)."""

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.nodes.compat.images import to_bytes

FIELDS = ("x", "y", "z", "normal_x", "normal_y", "normal_z")


def write_cloud(values: NDArray, frame_id: str, stamp: Time) -> PointCloud2:
    """Return points, with normals or without, as a cloud.

    Args:
        values: Shape (N, C) or, organised, (H, W, C): x, y, z in [m], then, for
            C = 6, the unit normal. NaN is kept.
        frame_id: Frame of the points.
        stamp: When they were seen.

    Raises:
        ShapeError: If C is neither 3 nor 6.
    """
    values = np.asarray(values, dtype=np.float32)
    if values.ndim not in (2, 3) or values.shape[-1] not in (3, 6):
        raise ShapeError("cloud", "(N, 3 or 6) or (H, W, 3 or 6)", values.shape)
    grid = values[None] if values.ndim == 2 else values
    height, width, channels = grid.shape
    cloud = PointCloud2(height=height, width=width)
    cloud.header.frame_id = frame_id
    cloud.header.stamp = stamp
    cloud.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate(FIELDS[:channels])
    ]
    cloud.point_step = 4 * channels
    cloud.row_step = cloud.point_step * width
    cloud.data = to_bytes(grid)
    cloud.is_dense = bool(np.isfinite(grid).all())
    return cloud


def read_points(cloud: PointCloud2) -> NDArray[np.float32]:
    """Return x, y, z of a cloud in [m], shape (H * W, 3), NaN kept.

    Raises:
        ShapeError: If the cloud has no float32 x, y, z or fewer bytes than it says.
    """
    known = {f.name: f for f in cloud.fields if f.datatype == PointField.FLOAT32}
    if not {"x", "y", "z"} <= set(known):
        raise ShapeError("cloud fields", "float32 x, y, z", (len(known),))
    order = ">f4" if cloud.is_bigendian else "<f4"
    dtype = np.dtype(
        {
            "names": ["x", "y", "z"],
            "formats": [order] * 3,
            "offsets": [known[axis].offset for axis in "xyz"],
            "itemsize": cloud.point_step,
        }
    )
    needed = cloud.row_step * cloud.height
    if len(cloud.data) < needed:
        raise ShapeError("cloud data", f"({needed},)", (len(cloud.data),))
    rows = np.frombuffer(cloud.data, np.uint8)[:needed].reshape(cloud.height, -1)
    points = np.ascontiguousarray(rows[:, : cloud.width * cloud.point_step])
    records = points.reshape(-1).view(dtype)
    return np.stack([records[axis] for axis in "xyz"], axis=-1).astype(np.float32)
