# SPDX-License-Identifier: Apache-2.0
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from nodes.fusion_rig import calibrated_rig  # noqa: E402
from nodes.standin import SurfacePlanner  # noqa: E402

from neugrasp_ros.fusion.tsdf import empty_volume  # noqa: E402
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.params import LiveConfig  # noqa: E402
from neugrasp_ros.nodes.planner_stages import (  # noqa: E402
    EvaluatorStage,
    RendererStage,
)
from neugrasp_ros.nodes.scene_view import SceneView  # noqa: E402
from neugrasp_ros.nodes.settings import EvaluatorConfig, RendererConfig  # noqa: E402
from neugrasp_ros.nodes.shared_planner import SharedPlanner  # noqa: E402

NOWHERE = SceneView(
    volume=empty_volume(8),
    T_frame_task=np.eye(4),
    frame_id="base_footprint",
    stamp=1,
    revision=1,
)


@pytest.fixture(scope="module")
def view() -> SceneView:
    rig = calibrated_rig()
    rig.scene.add_box((0.15, 0.15, 0.07))
    rig.shoot()
    return rig.fusion.view()


@pytest.fixture
def shared() -> SharedPlanner:
    return SharedPlanner(SurfacePlanner(), "any")


def test_a_scene_that_is_prepared_is_not_encoded_when_it_is_asked_about(shared, view):
    stage = RendererStage(shared, LiveConfig(RendererConfig()))
    stage.prepare(view)
    assert shared.planner.encoder_passes == 1
    staged = stage.sample(view, None, 8, 1)
    assert len(staged.grasps) and "encoding" not in staged.seconds
    assert shared.planner.encoder_passes == 1
    evaluator = EvaluatorStage(shared, LiveConfig(EvaluatorConfig()))
    evaluator.prepare(view)
    assert shared.planner.prepared == [view.revision]
    assert "quality" in evaluator.evaluate(staged.grasps, view).seconds
    assert shared.planner.encoder_passes == 1


def test_a_scene_is_encoded_above_the_support_that_is_configured(shared, view):
    renderer = RendererStage(shared, LiveConfig(RendererConfig(support_height=0.03)))
    evaluator = EvaluatorStage(shared, LiveConfig(EvaluatorConfig(support_height=0.02)))
    renderer.prepare(view)
    grasps = renderer.sample(view, None, 8, 1).grasps
    renderer.surface(view)
    evaluator.prepare(view)
    evaluator.evaluate(grasps, view)
    assert shared.planner.supports == [0.03, 0.03, 0.03, 0.02, 0.02]


def test_the_newest_scene_is_that_of_the_latest_revision(shared):
    stage = EvaluatorStage(shared, LiveConfig(EvaluatorConfig()))
    older, newer = NOWHERE, replace(NOWHERE, revision=2)
    assert not stage.knows_newer(older)
    stage.remember(newer)
    stage.remember(older)  # again, by a request about it
    assert stage.knows_newer(older) and not stage.knows_newer(newer)
    unnamed = GraspList(
        GraspInfo(frame_id="base"), GraspSet(np.eye(4)[None], np.ones(1))
    )
    assert stage.view_of(unnamed, time.monotonic()) is newer


def test_a_scene_without_a_measurement_is_not_encoded(shared):
    with pytest.raises(DetectionError) as caught:
        RendererStage(shared, LiveConfig(RendererConfig())).prepare(NOWHERE)
    assert caught.value.code is Code.EMPTY_WORKSPACE
    EvaluatorStage(shared, LiveConfig(EvaluatorConfig())).prepare(NOWHERE)
    assert shared.planner.encoder_passes == 0
