# SPDX-License-Identifier: Apache-2.0
"""Scenes that come from files, in ``DepthFusion``."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.fusion_rig import SECOND, Rig, box_points, calibrated_rig  # noqa: E402

from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.settings import WorkspaceConfig  # noqa: E402


@pytest.fixture
def rig() -> Rig:
    return calibrated_rig()


def test_nothing_fused_cannot_be_saved(rig):
    with pytest.raises(DetectionError, match="nothing to save") as caught:
        rig.fusion.saved()
    assert caught.value.code is Code.NO_DEPTH


def test_a_loaded_scene_stays_until_the_next_image(rig):
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.shoot()
    saved = rig.fusion.saved()
    rig.scene.clear()
    rig.shoot()
    before = rig.fusion.view()
    rig.fusion.load(saved)
    rig.time += 60 * SECOND
    view = rig.fusion.view()
    assert view.revision > before.revision and view.stamp == rig.time - 60 * SECOND
    assert len(box_points(rig, [0.15, 0.15, 0.09]))
    rig.shoot()
    assert not len(box_points(rig, [0.15, 0.15, 0.09]))
    assert rig.fusion.view().stamp == rig.time
    rig.time += 3 * SECOND
    assert rig.reason().code is Code.STALE_DEPTH


def test_a_scene_of_another_workspace_keeps_its_place_and_is_not_fused_into():
    rig = calibrated_rig(view_mode="fuse")
    rig.shoot()
    elsewhere = WorkspaceConfig(frame="map", origin=(1.0, 2.0, 3.0))
    rig.fusion.load(rig.fusion.saved()._replace(workspace=elsewhere))
    view = rig.fusion.view()
    assert view.frame_id == "map"
    np.testing.assert_allclose(view.T_frame_task[:3, 3], [1.0, 2.0, 3.0])
    rig.shoot()
    assert rig.fusion.view().frame_id == "base"
    assert rig.fusion.view().volume.view_count == 1


def test_a_loaded_scene_has_no_time_while_no_images_are_taken(rig):
    """Its stamp 0 stands for the newest transforms, and it is newer than any time."""
    rig.shoot()
    rig.fusion.load(rig.fusion.saved())
    rig.config.current = replace(rig.config.current, integrating=False)
    rig.time += 60 * SECOND
    view = rig.fusion.view()
    assert view.stamp == 0 and view.is_newer(rig.time)
    rig.config.current = replace(rig.config.current, integrating=True)
    view = rig.fusion.view()
    assert view.stamp == rig.time - 60 * SECOND and not view.is_newer(rig.time)
    rig.shoot()
    assert rig.fusion.view().stamp == rig.time


def test_whoever_waits_for_images_in_vain_hears_that_none_are_taken(rig):
    rig.shoot()
    rig.config.current = replace(rig.config.current, integrating=False)
    rig.time += 3 * SECOND
    assert rig.reason().sentence.endswith("; integrating is off")
    rig.fusion.reset()
    assert "was cleared; integrating is off" in rig.reason().sentence
