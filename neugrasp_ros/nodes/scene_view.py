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
        stamp: Time of the newest depth image in it, in [ns]; 0 = it was loaded from
            a file and is shown as if seen now, in the newest transforms.
        revision: Grows with every change of the volume.
        seconds: Time that the newest image took to fuse, in [s].
    """

    volume: TsdfVolume
    T_frame_task: NDArray[np.float64]
    frame_id: str
    stamp: int
    revision: int
    seconds: float = 0.0

    def is_newer(self, than: int) -> bool:
        """Tell whether it is newer than a time in [ns]; a loaded scene always is."""
        return not self.stamp or self.stamp > than
