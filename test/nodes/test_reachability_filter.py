# SPDX-License-Identifier: Apache-2.0
"""The node's services, called without a user, with known boxes in the map."""

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import Grasp, GraspArray  # noqa: E402
from neugrasp_msgs.srv import CheckReachability  # noqa: E402
from nodes.standin import SideChecker  # noqa: E402

from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.nodes.compat.tf import Buffer, to_transform  # noqa: E402
from neugrasp_ros.nodes.conversions import to_pose, to_stamp  # noqa: E402
from neugrasp_ros.nodes.markers import LabelledBox, box_markers  # noqa: E402
from neugrasp_ros.nodes.reachability_filter import (  # noqa: E402
    ReachabilityFilterNode,
)
from neugrasp_ros.nodes.transforms import Transforms  # noqa: E402

pytestmark = pytest.mark.ros

BASE = SideChecker.base_frame
SECOND = 10**9


class Noting(SideChecker):
    """Notes where boxes are when they are asked for."""

    def __init__(self) -> None:
        self.seen: list[float] = []

    def check(self, T_base_grippers, arms, start, points, boxes=()):
        self.seen += [box.T_base_box[0, 3] for box in boxes]
        return super().check(T_base_grippers, arms, start, points, boxes)

    def suggest_base(self, T_base_grippers, arms, start, points, boxes=()):
        self.seen += [box.T_base_box[0, 3] for box in boxes]
        return super().suggest_base(T_base_grippers, arms, start, points, boxes)


@pytest.fixture
def buffer():
    return Buffer()


@pytest.fixture
def checker():
    return Noting()


@pytest.fixture
def node(spinner, buffer, checker):
    return spinner.add(ReachabilityFilterNode(lambda _: checker, Transforms(buffer)))


def asked(call) -> CheckReachability.Response:
    grasp = Grasp(id="g", pose=to_pose(np.eye(4)), width=0.04)
    grasps = GraspArray(axes=GraspArray.AXES_Z_APPROACH_Y_CLOSING, grasps=[grasp])
    grasps.header.frame_id = BASE
    request = CheckReachability.Request(grasps=grasps)
    return call(request, CheckReachability.Response())


def test_nothing_is_checked_while_the_place_of_a_known_box_is_not_known(
    node, buffer, checker
):
    table = LabelledBox("table", translation(1.0, 0, 0), np.ones(3))
    node.stage.boxes.remember(box_markers([table], "map", to_stamp(0)))
    for call in (node._on_check, node._on_suggest_base):
        answer = asked(call)
        assert not answer.success and not answer.grasps.grasps
        assert answer.message.startswith(f"TF_ERROR: collision_boxes: {BASE} <- map")
    for second, x in ((1, 0.0), (2, 0.25)):  # the base drives towards the table
        place = to_transform(translation(x, 0, 0), "map", BASE, second * SECOND)
        buffer.set_transform(place, "")
        for call in (node._on_check, node._on_suggest_base):
            answer = asked(call)
            assert answer.success, answer.message
    assert checker.seen == [1.0, 1.0, 0.75, 0.75]
