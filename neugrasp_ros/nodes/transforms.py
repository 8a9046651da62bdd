# SPDX-License-Identifier: Apache-2.0
"""Transforms between frames as arrays, with the library's errors."""

import numpy as np
from numpy.typing import NDArray
from rclpy.time import Time

from neugrasp_ros.nodes.compat.tf import (
    Buffer,
    TransformException,
    frame_names,
    from_transform,
)
from neugrasp_ros.nodes.outcomes import Code, DetectionError


class Transforms:
    """Looks transforms up in a buffer.

    Args:
        buffer: A buffer that a listener feeds.
    """

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer

    def frames(self) -> tuple[str, ...]:
        """Return the names of all known frames."""
        return frame_names(self._buffer)

    def __call__(self, target: str, source: str, stamp: int) -> NDArray[np.float64]:
        """Return ``T_target_source`` at a time in [ns], 0 = the newest, (4, 4).

        Raises:
            DetectionError: TF_ERROR, naming the link.
        """
        if target == source:
            return np.eye(4)
        try:
            found = self._buffer.lookup_transform(
                target, source, Time(nanoseconds=stamp)
            )
        except TransformException as error:
            raise DetectionError(
                Code.TF_ERROR, f"{target} <- {source}: {error}"
            ) from error
        return from_transform(found)
