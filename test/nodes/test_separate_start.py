# SPDX-License-Identifier: Apache-2.0
"""While the stage nodes start, the server names those that are missing."""

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import DetectionReport  # noqa: E402
from nodes.separate_bench import SeparateBench, make_planner  # noqa: E402

from neugrasp_ros.nodes.grasp_evaluator import GraspEvaluatorNode  # noqa: E402
from neugrasp_ros.nodes.grasp_server import GraspServerNode  # noqa: E402

pytestmark = pytest.mark.ros


@pytest.fixture
def bench(ros):
    bench = SeparateBench()
    yield bench
    bench.stop()


def test_a_server_alone_misses_every_stage(bench):
    bench.add(GraspServerNode())
    report = bench.user.ask().report
    assert report.code == DetectionReport.NOT_ACTIVE
    for name in ("tsdf_fusion", "scene_renderer", "grasp_evaluator"):
        assert name in report.message


def test_the_one_that_is_missing_is_named_until_it_is_there(bench, wait_until):
    bench.camera.scene.add_box((0.15, 0.22, 0.07))
    bench.start_separate(evaluator=False)
    wait_until(
        lambda: "tsdf_fusion" not in bench.user.ask().report.message, seconds=30.0
    )
    report = bench.user.ask().report
    assert report.code == DetectionReport.NOT_ACTIVE
    assert "grasp_evaluator" in report.message
    bench.add(GraspEvaluatorNode(make_planner))
    wait_until(lambda: bench.user.ask(scene=1).success, seconds=60.0)
