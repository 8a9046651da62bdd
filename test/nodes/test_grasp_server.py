# SPDX-License-Identifier: Apache-2.0
from contextlib import nullcontext

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import GraspArray  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from nodes.bench import LEFT, mask_of  # noqa: E402
from nodes.synthetic import camera_info  # noqa: E402
from rclpy.qos import qos_profile_sensor_data  # noqa: E402
from sensor_msgs.msg import CameraInfo  # noqa: E402

from neugrasp_ros.nodes.compat.tf import Buffer  # noqa: E402
from neugrasp_ros.nodes.detection import Progress  # noqa: E402
from neugrasp_ros.nodes.grasp_server import GraspServerNode  # noqa: E402
from neugrasp_ros.nodes.local_stages import LocalStages  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.transforms import Transforms  # noqa: E402

pytestmark = pytest.mark.ros


def test_a_mask_of_a_camera_that_is_not_calibrated_says_so(spinner, wait_until):
    stages = LocalStages(Transforms(Buffer()))  # nothing is loaded
    server = spinner.add(GraspServerNode(stages))
    request = DetectGrasps.Request(mask=mask_of(LEFT))
    camera = server.create_publisher(
        CameraInfo, "depth/camera_info", qos_profile_sensor_data
    )

    def answers(info: CameraInfo, sentence: str) -> bool:
        camera.publish(info)
        return sentence in server.detect(request, Progress()).report.message

    unknown = camera_info()
    unknown.k, unknown.p = [0.0] * 9, [0.0] * 12
    wait_until(lambda: answers(unknown, "the camera is not calibrated"), seconds=30.0)
    report = server.detect(request, Progress()).report
    assert report.code == Code.NO_CAMERA_INFO
    assert "none has come yet" not in report.message
    wait_until(lambda: answers(camera_info(), "not ready: "), seconds=30.0)


class NoScene:
    """Stages that note how new a scene has to be, and have none."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def missing(self):
        return []

    def request(self):
        return nullcontext()

    def labels(self, deadline):
        return ()

    def scene(self, wanted, newer_than, deadline, stop):
        self.asked.append(newer_than)
        raise DetectionError(Code.NO_DEPTH, "no scene here")


def test_an_execution_before_time_jumped_back_is_forgotten(spinner, monkeypatch):
    stages = NoScene()
    server = spinner.add(GraspServerNode(stages))
    for now in (900, 950, 100, 960):
        monkeypatch.setattr(server, "_now", lambda now=now: now)
        if now == 900:
            server._on_executed(GraspArray())
        report = server.detect(DetectGrasps.Request(), Progress()).report
        assert report.message == "no scene here"
    assert stages.asked == [900, 900, 0, 0]
