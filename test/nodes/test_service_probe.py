# SPDX-License-Identifier: Apache-2.0
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import DetectionReport  # noqa: E402

from neugrasp_ros.nodes.service_probe import Answer, figures  # noqa: E402

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
