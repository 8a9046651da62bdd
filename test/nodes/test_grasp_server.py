# SPDX-License-Identifier: Apache-2.0
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from nodes.bench import LEFT, mask_of  # noqa: E402
from nodes.synthetic import camera_info  # noqa: E402
from rclpy.qos import qos_profile_sensor_data  # noqa: E402
from sensor_msgs.msg import CameraInfo  # noqa: E402

from neugrasp_ros.nodes.compat.tf import Buffer  # noqa: E402
from neugrasp_ros.nodes.detection import Progress  # noqa: E402
from neugrasp_ros.nodes.grasp_server import GraspServerNode  # noqa: E402
from neugrasp_ros.nodes.local_stages import LocalStages  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code  # noqa: E402
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
