# SPDX-License-Identifier: Apache-2.0
import threading

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import DetectionReport  # noqa: E402
from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from rclpy.callback_groups import ReentrantCallbackGroup  # noqa: E402
from rclpy.node import Node  # noqa: E402
from sensor_msgs.msg import Image  # noqa: E402

from neugrasp_ros.benchmark.shots import Shot  # noqa: E402
from neugrasp_ros.geometry.camera import Intrinsics  # noqa: E402
from neugrasp_ros.nodes import service_probe  # noqa: E402
from neugrasp_ros.nodes.client import NoAnswerError  # noqa: E402
from neugrasp_ros.nodes.qos import sensor_input  # noqa: E402
from neugrasp_ros.nodes.service_probe import Answer, figures, measure  # noqa: E402
from neugrasp_ros.nodes.table import DEPTH_TOPICS  # noqa: E402

NONE, TIMEOUT = DetectionReport.NONE, DetectionReport.TIMEOUT


def test_what_ros_adds_is_the_latency_without_the_stages():
    answers = [Answer(0.3 + 0.01 * n, 0.28, NONE) for n in range(11)]
    found = figures([*answers, Answer(9.0, 0.0, TIMEOUT)])
    assert found["n"] == 11 and found["failed"] == 1
    assert found["latency_ms_median"] == pytest.approx(350.0)
    assert found["library_ms_p90"] == pytest.approx(280.0)
    assert found["extra_ms_median"] == pytest.approx(70.0)
    assert found["extra_ms_p90"] == pytest.approx(110.0)


def test_without_an_answer_there_is_no_figure():
    assert figures([Answer(9.0, 0.0, TIMEOUT)]) == {"n": 0, "failed": 1}


class Suite(Node):
    """Answers each question with the next code, once it has seen a new image.

    A code of None is an answer that never comes while the test runs.
    """

    def __init__(self, codes) -> None:
        super().__init__("suite")
        self.codes, self.seeds, self.over = list(codes), [], threading.Event()
        self._seen = threading.Event()
        group = {"callback_group": ReentrantCallbackGroup()}
        topic = DEPTH_TOPICS["depth/image"]
        self.create_subscription(
            Image, topic, lambda _: self._seen.set(), sensor_input(), **group
        )
        self.create_service(DetectGrasps, "detect_grasps", self._answer, **group)

    def _answer(self, request, response):
        self._seen.clear()
        self.seeds.append(request.seed)
        code = self.codes.pop(0)
        if code is None:
            self.over.wait(20.0)
        elif not self._seen.wait(5.0):
            code = DetectionReport.TIMEOUT
        response.report.code = code or DetectionReport.NONE
        response.report.seconds_fusion = 0.25
        response.report.message = "the robot is still loading"
        return response


SHOT = Shot(
    np.full((6, 8), 0.5, np.float32),
    Intrinsics.from_hfov(8, 6, 1.0),
    np.eye(4),
    (0.3, 0.3, 0.3),
    np.zeros((0, 3)),
)


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(service_probe, "TIMEOUT", 1.0)
    monkeypatch.setattr(service_probe, "RETRY", 0.01)


def test_questions_before_the_first_grasps_may_be_lost_or_refused(spinner, impatient):
    codes = [None, DetectionReport.NOT_ACTIVE, NONE, NONE, TIMEOUT, NONE]
    suite, counted = spinner.add(Suite(codes)), []
    try:
        found = measure([SHOT], 3, 60.0, after=counted.append, pause=0.1)
    finally:
        suite.over.set()
    assert counted == [1, 2, 3]
    assert found["n"] == 2 and found["failed"] == 1
    assert found["library_ms_median"] == pytest.approx(250.0)
    assert found["latency_ms_median"] > 0
    assert suite.seeds == [1, 2, 3, 4, 5, 6]


def test_without_grasps_in_time_the_last_code_is_told(spinner, impatient):
    spinner.add(Suite([DetectionReport.NOT_ACTIVE] * 1000))
    code = DetectionReport.NOT_ACTIVE
    with pytest.raises(NoAnswerError, match=f"start; last: code {code} the robot"):
        measure([SHOT], 1, 1.0)


def test_a_suite_that_has_ended_is_not_waited_for(ros):
    with pytest.raises(NoAnswerError, match="the suite has ended"):
        measure([SHOT], 1, 60.0, lambda: False)
