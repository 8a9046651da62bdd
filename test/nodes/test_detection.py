# SPDX-License-Identifier: Apache-2.0
from contextlib import nullcontext
from dataclasses import fields, replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.srv import DetectGrasps  # noqa: E402
from nodes.standin import SideChecker  # noqa: E402

from neugrasp_ros.fusion.tsdf import empty_volume  # noqa: E402
from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.detection import Detection, Progress  # noqa: E402
from neugrasp_ros.nodes.grasp_list import (  # noqa: E402
    STAGE_REACHABLE,
    STAGE_SCORED,
    GraspInfo,
    GraspList,
)
from neugrasp_ros.nodes.params import LiveConfig  # noqa: E402
from neugrasp_ros.nodes.planner_stages import Staged  # noqa: E402
from neugrasp_ros.nodes.reach_stage import ReachStage  # noqa: E402
from neugrasp_ros.nodes.requests import REACH_FIRST, REACH_LAST, read_request  # noqa: E402
from neugrasp_ros.nodes.scene_view import SceneView  # noqa: E402
from neugrasp_ros.nodes.settings import ReachConfig, ServerConfig  # noqa: E402

VIEW = SceneView(
    volume=empty_volume(8),
    T_frame_task=np.eye(4),
    frame_id="base_footprint",
    stamp=1,
    revision=1,
)
SIDES = np.array([0.1, 0.2, -0.1, -0.2])  # [m]; the left arm's are sampled first


class TwoArms:
    """Stages with candidates for either arm, whose scores are given."""

    def __init__(self, quality: list[float]) -> None:
        self.quality = np.array(quality)
        self.reach = ReachStage(
            SideChecker(), LiveConfig(ReachConfig()), lambda *_: np.eye(4), lambda: {}
        )

    def missing(self):
        return []

    def request(self):
        return nullcontext()

    def labels(self, deadline):
        return ()

    def scene(self, wanted, newer_than, deadline, stop):
        return VIEW

    def transform(self, target, source, stamp):
        return np.eye(4)

    def sample(self, view, roi, wanted, deadline):
        poses = np.array([translation(0.0, y, 0.0) for y in SIDES])
        info = GraspInfo(frame_id=view.frame_id, tcp_frame="of the renderer")
        return Staged(GraspList(info, GraspSet(poses, np.ones(len(poses)))), {})

    def begin_scores(self, grasps, view, deadline):
        rows = [
            int(np.flatnonzero(SIDES == y)[0]) for y in grasps.grasps.poses[:, 1, 3]
        ]
        scores = grasps.grasps.with_scores(self.quality[rows], np.zeros((len(rows), 0)))
        info = replace(grasps.info, stage=STAGE_SCORED)
        return lambda: Staged(replace(grasps, info=info, grasps=scores), {})

    def check(self, grasps, arms, deadline):
        return self.reach.check(grasps, arms)


@pytest.mark.parametrize("reachability", [REACH_FIRST, REACH_LAST])
@pytest.mark.parametrize(
    ("quality", "side"),
    [([0.6, 0.7, 0.8, 0.9], "right"), ([0.9, 0.8, 0.7, 0.6], "left")],
)
def test_the_hand_is_that_of_the_best_grasp_and_the_list_is_checked(
    reachability, quality, side
):
    config = ServerConfig()
    wanted = read_request(DetectGrasps.Request(reachability=reachability), config)
    outcome = Detection(TwoArms(quality), config, wanted, Progress()).run()
    assert not outcome.report.code, outcome.report.message
    assert len(outcome.grasps) == len(SIDES)
    assert outcome.grasps.reach.arms[0] == f"arm_{side}_torso"
    assert outcome.grasps.info.tcp_frame == f"gripper_{side}_tcp"
    assert outcome.grasps.info.stage == STAGE_REACHABLE


def test_the_server_has_no_parameter_for_what_the_renderer_says():
    assert not {"axes", "tcp_frame"} & {item.name for item in fields(ServerConfig)}
