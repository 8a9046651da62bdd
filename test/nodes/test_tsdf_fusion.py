# SPDX-License-Identifier: Apache-2.0
import threading
import time

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import TsdfVolume  # noqa: E402
from neugrasp_msgs.srv import GetTsdf  # noqa: E402
from nodes.camera_node import CameraNode, ClientNode  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from sensor_msgs.msg import PointCloud2  # noqa: E402
from std_srvs.srv import SetBool, Trigger  # noqa: E402

from neugrasp_ros.fusion.tsdf import seen_surface  # noqa: E402
from neugrasp_ros.nodes.conversions import from_tsdf  # noqa: E402
from neugrasp_ros.nodes.qos import latched  # noqa: E402
from neugrasp_ros.nodes.tsdf_fusion import (  # noqa: E402
    SHOW_DELAY,
    TsdfFusionNode,
)

pytestmark = pytest.mark.ros

BOX = (0.15, 0.15, 0.07)


class Rig:
    def __init__(self, spinner, serves=lambda: False, **parameters) -> None:
        patient = {"max_depth_age": 30.0}  # [s]; on a busy machine images come late
        given = patient | parameters
        overrides = [Parameter(name, value=v) for name, v in given.items()]
        self.fusion = spinner.add(TsdfFusionNode(serves, parameter_overrides=overrides))
        self.camera = spinner.add(CameraNode())
        self.user = spinner.add(ClientNode())
        self.camera.send_tf()

    def call(self, kind, name, **fields):
        return self.user.call(kind, f"tsdf_fusion/{name}", **fields)

    def shows_box(self) -> bool:
        answer = self.call(GetTsdf, "get_tsdf")
        if not answer.success:
            return False
        points, _ = seen_surface(from_tsdf(answer.volume).volume)
        return bool((points[:, 2] > 0.08).any())


def test_a_scene_is_saved_and_shown_again(spinner, wait_until, tmp_path):
    path = tmp_path / "scene.npz"
    rig = Rig(spinner, scene_path=str(path))
    rig.camera.scene.add_box(BOX)
    wait_until(rig.shows_box, seconds=30.0)
    saved = rig.call(Trigger, "save")
    assert saved.success and saved.message == f"scene written to {path}"
    rig.camera.scene.clear()
    wait_until(lambda: not rig.shows_box(), seconds=30.0)
    loaded = rig.call(Trigger, "load")
    assert loaded.success
    assert "counts as fresh; integrating is off" in loaded.message
    assert rig.shows_box()
    assert not rig.fusion.get_parameter("integrating").value
    assert rig.call(SetBool, "set_integrating", data=True).success
    wait_until(lambda: not rig.shows_box(), seconds=30.0)


def test_what_only_people_look_at_waits_for_requests_that_run(spinner, wait_until):
    running = threading.Event()
    running.set()
    rig = Rig(spinner, running.is_set)
    heard = {"tsdf": [], "scene_cloud": []}
    for kind, topic in ((TsdfVolume, "tsdf"), (PointCloud2, "scene_cloud")):
        rig.user.create_subscription(kind, topic, heard[topic].append, latched())
    wait_until(lambda: heard["tsdf"], seconds=30.0)
    time.sleep(4 * SHOW_DELAY)
    assert not heard["scene_cloud"]
    running.clear()
    wait_until(lambda: heard["scene_cloud"])


def test_a_file_that_is_no_scene_leaves_everything_as_it_is(
    spinner, wait_until, tmp_path
):
    path = tmp_path / "scene.npz"
    path.write_text("no scene")
    rig = Rig(spinner, scene_path=str(path))
    rig.camera.scene.add_box(BOX)
    wait_until(rig.shows_box, seconds=30.0)
    answer = rig.call(Trigger, "load")
    assert not answer.success
    assert answer.message.startswith(f"INVALID_REQUEST: {path}: is no scene file")
    assert rig.fusion.get_parameter("integrating").value and rig.shows_box()


def test_without_a_path_or_a_view_the_services_say_so(spinner, tmp_path):
    rig = Rig(spinner)
    for name in ("save", "load"):
        answer = rig.call(Trigger, name)
        assert not answer.success and "set scene_path" in answer.message
    result = rig.fusion.set_parameters([Parameter("scene_path", value="/tmp/x.npz")])
    assert not result[0].successful  # a caller must not choose where we write
