# SPDX-License-Identifier: Apache-2.0
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from builtin_interfaces.msg import Duration  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from nodes.fusion_rig import SECOND, Rig, calibrated_rig  # noqa: E402
from nodes.synthetic import CAMERA_FRAME  # noqa: E402

from neugrasp_ros.nodes.compat.tf import Buffer  # noqa: E402
from neugrasp_ros.nodes.compat.tf_buffer import to_transform  # noqa: E402
from neugrasp_ros.nodes.local_stages import LocalStages  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.requests import read_request  # noqa: E402
from neugrasp_ros.nodes.settings import ServerConfig  # noqa: E402
from neugrasp_ros.nodes.transforms import Transforms  # noqa: E402


@pytest.fixture
def rig() -> Rig:
    """Return a rig that shows a loaded scene since a minute."""
    rig = calibrated_rig()
    rig.shoot()
    rig.fusion.load(rig.fusion.saved())
    rig.config.current = replace(rig.config.current, integrating=False)
    rig.time += 60 * SECOND
    return rig


def scene_of(rig: Rig, stages: LocalStages, newer_than: int):
    """Ask for a scene newer than a time, at once."""
    stages.fusion = rig.fusion
    request = DetectGrasps.Request(timeout=Duration(nanosec=1))
    wanted = read_request(request, ServerConfig())
    return stages.scene(wanted, newer_than, time.monotonic())


def test_a_loaded_scene_answers_who_wants_a_fresh_one_until_images_are_taken(rig):
    stages = LocalStages(Transforms(Buffer()))
    assert scene_of(rig, stages, rig.time).volume.view_count == 1
    rig.config.current = replace(rig.config.current, integrating=True)
    with pytest.raises(DetectionError, match="no depth image newer") as caught:
        scene_of(rig, stages, rig.time)
    assert caught.value.code is Code.TIMEOUT
    rig.shoot()
    assert scene_of(rig, stages, rig.time - 1).stamp == rig.time


def test_a_loaded_scene_is_looked_at_in_the_newest_transforms(rig):
    buffer, T = Buffer(), np.eye(4)
    for stamp in range(0, rig.time, SECOND):  # more than is remembered
        T[0, 3] = stamp / SECOND
        buffer.set_transform(to_transform(T, "base", CAMERA_FRAME, stamp), "")
    stages = LocalStages(Transforms(buffer))
    view = scene_of(rig, stages, 0)
    found = stages.transform("base", CAMERA_FRAME, view.stamp)
    np.testing.assert_allclose(found, T)


def test_who_waits_for_more_views_can_cancel(rig):
    stages = LocalStages(Transforms(Buffer()))
    stages.fusion = rig.fusion
    wanted = read_request(DetectGrasps.Request(min_views=5), ServerConfig())
    start = time.monotonic()
    with pytest.raises(DetectionError) as caught:
        stages.scene(wanted, 0, start + 30, lambda: time.monotonic() > start + 0.2)
    assert caught.value.code is Code.CANCELED
    assert time.monotonic() - start < 5
