# SPDX-License-Identifier: Apache-2.0
"""A fused scene as one value: the volume, where it is, when and which it is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.fusion.tsdf import TsdfVolume


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneView:
    """A volume and its circumstances.

    Attributes:
        volume: The fused volume, in its task frame.
        T_frame_task: Pose of the task frame in ``frame_id``, shape (4, 4).
        frame_id: TF frame.
        stamp: Time of the newest depth image in it, in [ns].
        revision: Grows with every change of the volume.
        seconds: Time that the newest image took to fuse, in [s].
    """

    volume: TsdfVolume
    T_frame_task: NDArray[np.float64]
    frame_id: str
    stamp: int
    revision: int
    seconds: float = 0.0
