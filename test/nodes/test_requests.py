# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from builtin_interfaces.msg import Duration  # noqa: E402
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3  # noqa: E402
from neugrasp_msgs.action import DetectGrasps as DetectAction  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from sensor_msgs.msg import Image  # noqa: E402

from neugrasp_ros.geometry.camera import Intrinsics  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.requests import read_request  # noqa: E402
from neugrasp_ros.nodes.settings import ServerConfig  # noqa: E402
from neugrasp_ros.nodes.target_mask import Camera  # noqa: E402

NAN, INF = float("nan"), float("inf")
CUBE = Vector3(x=0.1, y=0.1, z=0.1)


CAMERA = Camera(Intrinsics(4, 3, 5.0, 5.0, 1.5, 1.0), "camera")


def mask(*, width=4, encoding="mono8", frame="", value=255) -> Image:
    image = Image(height=3, width=width, encoding=encoding, data=[value] * 3 * width)
    image.header.frame_id = frame
    return image


def box(**pose) -> dict:
    upright = Quaternion(w=1.0)
    return {
        "roi_size": CUBE,
        "roi_pose": PoseStamped(pose=Pose(**({"orientation": upright} | pose))),
    }


@pytest.mark.parametrize("kind", [DetectGrasps.Request, DetectAction.Goal])
def test_an_empty_request_means_the_parameters(kind):
    config = ServerConfig(max_grasps=7, min_quality=0.25, timeout=3.0, scene="fresh")
    wanted = read_request(kind(), config)
    assert (wanted.max_grasps, wanted.min_quality, wanted.timeout) == (7, 0.25, 3.0)
    assert wanted.scene == kind.SCENE_FRESH and wanted.reachability == kind.REACH_LAST
    assert (
        wanted.target is None
        and wanted.roi is None
        and wanted.arms == ()
        and wanted.budget == 0.0
    )
    assert wanted.frame_id == "base_footprint" == wanted.roi_frame


def test_what_is_asked_for_wins():
    request = DetectGrasps.Request(
        min_quality=0.0, max_candidates=9, time_budget=Duration(nanosec=500_000_000)
    )
    wanted = read_request(request, ServerConfig(min_quality=0.5))
    assert (wanted.min_quality, wanted.max_candidates, wanted.budget) == (0.0, 9, 0.5)


def test_a_region_is_a_box_about_its_pose():
    request = DetectGrasps.Request(**box(position=Point(x=0.5, y=0.1, z=0.7)))
    request.roi_pose.header.frame_id = "map"
    wanted = read_request(request, ServerConfig())
    assert wanted.roi is not None and wanted.roi_frame == "map"
    np.testing.assert_allclose(wanted.roi.T_frame_box[:3, 3], [0.5, 0.1, 0.7])
    np.testing.assert_allclose(wanted.roi.size, 0.1)


def test_a_mask_names_the_target():
    request = DetectGrasps.Request(mask=mask(frame="camera"))
    request.mask.header.stamp.sec = 7
    target = read_request(request, ServerConfig(), CAMERA).target
    assert target.pixels.shape == (3, 4) and target.pixels.all()
    assert target.camera is CAMERA and target.stamp == 7 * 10**9


def test_a_mask_without_a_camera_says_what_is_missing():
    with pytest.raises(DetectionError, match="a mask needs depth/camera_info") as error:
        read_request(DetectGrasps.Request(mask=mask()), ServerConfig())
    assert error.value.code is Code.NO_CAMERA_INFO
    assert error.value.sentence.endswith("none has come yet")
    with pytest.raises(DetectionError, match="camera_info; its lens is broken$"):
        read_request(
            DetectGrasps.Request(mask=mask()),
            ServerConfig(),
            None,
            "its lens is broken",
        )


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"min_quality": NAN}, "min_quality must be within 0..1"),
        ({"min_quality": INF}, "min_quality must be within 0..1"),
        ({"min_affordance": 1.01}, "min_affordance must be within 0..1"),
        ({"time_budget": Duration(sec=-1)}, "time_budget must not be negative, got -1"),
        ({"timeout": Duration(sec=-1)}, "timeout must not be negative, got -1.0 s"),
        ({"max_candidates": 10_001}, "max_candidates must be at most 10000, got 10001"),
        ({"reachability": 3}, "reachability must be 0, 1 or 2, got 3"),
        ({"scene": 3}, "scene must be 0, 1 or 2, got 3"),
        ({"roi_size": Vector3(x=-0.1, y=0.1, z=0.1)}, "roi_size must be positive"),
        ({"roi_size": Vector3(x=INF, y=0.1, z=0.1)}, "roi_size must be positive"),
        ({"roi_size": Vector3(x=0.1)}, "roi_size has a zero edge"),
        (box(position=Point(x=NAN)), "roi_pose: a pose holds a number that is not fin"),
        (box(orientation=Quaternion(w=0.0)), "roi_pose: a quaternion has length 0, "),
        (box(orientation=Quaternion(w=9.0)), "roi_pose: a quaternion has length 9, "),
        ({"mask": Image(height=2, width=2)}, "image encoding ''; expected one of mono"),
        (
            {"mask": Image(height=2, width=2, encoding="mono8")},
            "a 2x2 mono8 image needs 4 bytes, got 0",
        ),
        ({"mask": mask(width=2)}, "mask is 2x3, but depth/camera_info says 4x3"),
        ({"mask": mask(encoding="rgb8")}, "image encoding 'rgb8'; expected one of mon"),
        ({"mask": mask(frame="wrist")}, "mask is of camera 'wrist', but depth/camera_"),
        ({"mask": mask(value=0)}, "mask: no pixel is set"),
    ],
)
def test_a_bad_field_is_refused_by_name(fields, sentence):
    with pytest.raises(DetectionError) as caught:
        read_request(DetectGrasps.Request(**fields), ServerConfig(), CAMERA)
    assert caught.value.code is Code.INVALID_REQUEST
    assert sentence in caught.value.sentence
