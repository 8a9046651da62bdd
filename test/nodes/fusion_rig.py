# SPDX-License-Identifier: Apache-2.0
"""``DepthFusion`` under a camera over a table, with the clock in our hands."""

import numpy as np
import pytest
from nodes.synthetic import Scene, camera_info, depth_image

from neugrasp_ros.fusion.tsdf import seen_surface
from neugrasp_ros.nodes.compat.tf_buffer import LookupException
from neugrasp_ros.nodes.depth_fusion import DepthFusion
from neugrasp_ros.nodes.outcomes import DetectionError
from neugrasp_ros.nodes.params import LiveConfig
from neugrasp_ros.nodes.settings import FusionConfig, WorkspaceConfig

WORKSPACE = WorkspaceConfig(frame="base", origin=(0.5, -0.15, 0.7))
SECOND = 10**9


class Rig:
    """A camera over a table, a clock in our hands."""

    def __init__(self, workspace=WORKSPACE, **options) -> None:
        self.scene = Scene(WORKSPACE)
        self.config = LiveConfig(FusionConfig(workspace=workspace, **options))
        self.time = 5 * SECOND
        self.has_tf = True
        self.fusion = DepthFusion(
            self.config, self.lookup, lambda: self.time, lambda: self.time / SECOND
        )

    def lookup(self, target, source, stamp):
        if not self.has_tf:
            raise LookupException(f"frame {source!r} does not exist")
        return self.scene.T_base_camera

    def shoot(self, form="32FC1", **changes):
        self.time += SECOND // 10
        image = depth_image(self.scene.depth(), self.time, form)
        for name, value in changes.items():
            setattr(image, name, value)
        return self.fusion.on_depth(image)

    def reason(self) -> DetectionError:
        with pytest.raises(DetectionError) as caught:
            self.fusion.view()
        return caught.value


def calibrated_rig(**options) -> Rig:
    """Return a rig whose camera info has come."""
    rig = Rig(**options)
    rig.fusion.on_camera_info(camera_info())
    return rig


def box_points(rig: Rig, center) -> np.ndarray:
    """Return seen surface points within 3 cm of a place in the task frame."""
    points, _ = seen_surface(rig.fusion.view().volume)
    return points[np.linalg.norm(points - center, axis=1) < 0.03]
