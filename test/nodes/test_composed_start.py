# SPDX-License-Identifier: Apache-2.0
"""A composed suite that lacks something says what, in each case on its own."""

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import DetectionReport  # noqa: E402
from nodes.bench import Bench, ask  # noqa: E402

pytestmark = pytest.mark.ros


@pytest.fixture
def bench(ros):
    bench = Bench()
    yield bench
    bench.stop()


def test_a_request_while_the_suite_still_starts_names_what_is_loading(bench):
    report = ask(bench).report
    assert report.code == DetectionReport.NOT_ACTIVE
    assert "scene_renderer is still loading" in report.message


def test_without_depth_the_report_says_so(bench):
    bench.suite.load()
    report = ask(bench).report
    assert report.code == DetectionReport.NO_DEPTH
    assert "no depth/image" in report.message


def test_without_camera_info_the_report_says_so(bench, wait_until):
    bench.suite.load()
    bench.camera.sends = {"depth"}
    wait_until(lambda: ask(bench).report.code != DetectionReport.NO_DEPTH)
    assert ask(bench).report.code == DetectionReport.NO_CAMERA_INFO


def test_without_tf_the_missing_link_is_named(bench, wait_until):
    bench.suite.load()
    bench.camera.sends = {"depth", "info"}
    expected = DetectionReport.TF_ERROR
    wait_until(lambda: ask(bench).report.code == expected, seconds=20.0)
    assert "base_footprint <- camera_optical" in ask(bench).report.message
