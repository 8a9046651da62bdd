# SPDX-License-Identifier: Apache-2.0
"""What the demonstration's client makes of the answers it gets."""

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from builtin_interfaces.msg import Time  # noqa: E402
from diagnostic_msgs.msg import (  # noqa: E402
    DiagnosticArray,
    DiagnosticStatus,
    KeyValue,
)
from neugrasp_msgs.action import ExecuteGrasp  # noqa: E402
from neugrasp_msgs.msg import Grasp, GraspArray  # noqa: E402
from rcl_interfaces.msg import ParameterValue  # noqa: E402
from rcl_interfaces.srv import GetParameters, SetParameters  # noqa: E402
from sensor_msgs.msg import Image  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.manipulation.executor import GraspOutcome  # noqa: E402
from neugrasp_ros.nodes.compat.images import write_color  # noqa: E402
from neugrasp_ros.nodes.demo_client import DemoError  # noqa: E402
from neugrasp_ros.nodes.markers import LabelledBox, box_markers  # noqa: E402
from neugrasp_ros.nodes.robot_demo import TRIED, RobotDemoClient  # noqa: E402
from neugrasp_ros.pictures.film import Shot  # noqa: E402

pytestmark = pytest.mark.ros

BIN = LabelledBox("left", translation(0.3, 0.6, 0.3), np.array([0.3, 0.3, 0.6]))
SMALL = np.full(3, 0.05)
GRASPS = GraspArray(grasps=[Grasp(id=f"g{k}", quality=0.9) for k in range(5)])
REFUSAL = (GraspOutcome.UNREACHABLE, "no arm posture")
SUCCESS = (GraspOutcome.GRASPED, "lifted")


def cubes(*boxes):
    return box_markers(list(boxes), "base", Time())


def at(name, x, y, z):
    return LabelledBox(name, translation(x, y, z), SMALL)


class Client(RobotDemoClient):
    """A client whose services and arms are those of the test."""

    def __init__(self) -> None:
        super().__init__(lambda seconds: None)
        self._latest |= {
            "bins": cubes(BIN), "objects": cubes(at("mug", 0.6, 0.0, 0.75)),
        }  # fmt: skip
        self.outcomes, self.calls = [], []
        self.lands, self.lands_from_home = "mug", ""
        self.set_answer = SetParameters.Response()

    def _pause(self, seconds):
        pass

    def _carry_out(self, grasps, best):
        self.calls.append(best.id)
        return self.outcomes.pop(0)

    def _call(self, client, request, timeout=0.0):
        self.calls.append(client.srv_name.strip("/"))
        if client is self._drop and self.lands:
            self._latest["objects"] = cubes(at(self.lands, 0.3, 0.6, 0.4))
        if client is self._get:
            values = [ParameterValue(double_array_value=[0.4, -0.15, 0.65])]
            return GetParameters.Response(values=values)
        if client is self._set:
            self.wanted = request.parameters[0]
            return self.set_answer
        if client is self._home:
            self.lands, self.lands_from_home = self.lands_from_home, ""
        message = "" if self.lands else "no way"
        return Trigger.Response(success=bool(self.lands), message=message)


@pytest.fixture
def client(ros):
    client = Client()
    yield client
    client.destroy_node()


def test_what_lies_in_a_bin_is_cleared(client):
    client.outcomes = [SUCCESS]
    attempt = client._attempt(GRASPS)
    assert attempt.success and attempt.result == "cleared mug"
    assert client.calls == ["g0", "grasp_executor/drop"]


@pytest.mark.parametrize(
    ("place", "cleared"),
    [
        ((0.3, 0.6, 0.4), True),
        ((0.3, 0.6, 0.65), False),  # over its rim
        ((0.46, 0.6, 0.4), False),  # beside it
    ],
)
def test_in_a_bin_is_within_its_walls_and_under_its_rim(client, place, cleared):
    client._latest["objects"] = cubes(at("mug", *place))
    assert client._cleared() == ({"mug"} if cleared else set())


def test_a_refused_grasp_gives_way_to_the_next_best(client):
    client.outcomes = [REFUSAL, SUCCESS]
    attempt = client._attempt(GRASPS)
    assert attempt.success and attempt.grasp == "g1"
    assert client.calls[:2] == ["g0", "g1"]


def test_after_a_few_refusals_it_gives_up_and_says_why(client):
    client.outcomes = [REFUSAL] * 5
    attempt = client._attempt(GRASPS)
    assert not attempt.success and attempt.result == "no arm posture"
    assert client.calls == [f"g{k}" for k in range(TRIED)]


def test_a_miss_is_named_and_not_tried_again(client):
    client.outcomes = [(GraspOutcome.MISSED, "the jaws closed on nothing")]
    attempt = client._attempt(GRASPS)
    assert attempt.result == "MISSED: the jaws closed on nothing"
    assert client.calls == ["g0"]


def test_what_does_not_reach_the_bin_is_lost_and_the_arm_goes_home(client):
    client.outcomes, client.lands = [SUCCESS], ""
    attempt = client._attempt(GRASPS)
    assert not attempt.success and attempt.result == "LOST: no way"
    assert client.calls[-3:] == [
        "grasp_executor/drop", "grasp_executor/home", "grasp_executor/drop"
    ]  # fmt: skip


def test_what_has_no_way_to_the_bin_may_have_one_from_home(client):
    client.outcomes, client.lands, client.lands_from_home = [SUCCESS], "", "mug"
    assert client._attempt(GRASPS).result == "cleared mug"


def test_the_workspace_goes_to_the_height_of_the_furniture(client):
    top = LabelledBox("shelf", translation(0.6, 0.0, 0.785), np.array([0.4, 0.8, 0.03]))
    client._latest["support"] = cubes(top, BIN)
    client.set_answer.results = [_ok()]
    client.prepare_scene("shelf:packed")
    assert client.wanted.name == "workspace.origin"
    origin = list(client.wanted.value.double_array_value)
    assert origin == pytest.approx([0.4, -0.15, 0.75])
    assert client.calls[-1] == "tsdf_fusion/reset"


def test_at_the_usual_table_the_workspace_stays(client):
    table = LabelledBox("t", translation(0.6, 0.0, 0.685), np.array([0.6, 0.8, 0.03]))
    client._latest["support"] = cubes(table)
    client.shots.append(Shot(np.zeros((2, 3, 3), np.uint8)))
    client.prepare_scene("table:pile")
    assert not client.shots, "of what stood there before"
    assert client.calls == ["tsdf_fusion/get_parameters", "tsdf_fusion/reset"]


def test_a_workspace_that_cannot_be_moved_ends_the_demonstration(client):
    top = LabelledBox("shelf", translation(0.6, 0.0, 0.785), np.array([0.4, 0.8, 0.03]))
    client._latest["support"] = cubes(top)
    client.set_answer.results = [_ok(successful=False, reason="out of range")]
    with pytest.raises(DemoError, match="workspace.origin: out of range"):
        client.prepare_scene("shelf:packed")


def _ok(**fields):
    from rcl_interfaces.msg import SetParametersResult

    return SetParametersResult(**({"successful": True} | fields))


def test_the_largest_contact_of_the_run_is_remembered(client):
    for force in ("3.5", "12.0", "1.0"):
        status = DiagnosticStatus(
            values=[KeyValue(key="largest_contact_n", value=force)]
        )
        client._on_diagnostics(DiagnosticArray(status=[status]))
    assert client.largest_contact == 12.0


def test_pictures_that_show_nothing_new_are_left_out(client):
    def picture(value) -> Image:
        return write_color(np.full((2, 3, 3), value, np.uint8), "base", Time())

    for value in (10, 10, 20):
        client._on_view(picture(value))
    assert [int(shot.frame[0, 0, 0]) for shot in client.shots] == [10, 20]


def test_pictures_say_what_the_robot_does_and_how_far_it_is(client):
    def look(value):
        client._on_view(
            write_color(np.full((2, 3, 3), value, np.uint8), "base", Time())
        )
        return client.shots[-1].stage, client.shots[-1].tally

    assert look(0) == ("look", "0 of 1 in the boxes")
    seen, act = [], client._carry_out

    def carry_out(grasps, best):
        seen.append(look(1))
        for stage in ("plan", "approach", "close", "lift"):
            feedback = ExecuteGrasp.Feedback(stage=stage)
            client._on_progress(ExecuteGrasp.Impl.FeedbackMessage(feedback=feedback))
            seen.append(look(len(seen) + 1))
        return act(grasps, best)

    client._carry_out, client.outcomes = carry_out, [SUCCESS]
    client._attempt(GRASPS)
    assert [stage for stage, _ in seen] == ["reach"] * 3 + ["grasp", "lift"]
    assert look(9) == ("home", "1 of 1 in the boxes")


def test_a_late_picture_of_the_scene_before_is_left_out(client):
    client.set_answer.results = [_ok()]
    client._latest["support"] = box_markers(
        [at("table", 0.6, 0.0, 0.7)], "base", Time(sec=8)
    )
    client.prepare_scene("table")
    for second in (7, 8):
        picture = np.full((2, 3, 3), second, np.uint8)
        client._on_view(write_color(picture, "base", Time(sec=second)))
    assert [int(shot.frame[0, 0, 0]) for shot in client.shots] == [8]


def test_a_picture_before_the_first_scene_is_harmless(client):
    client._latest.clear()
    client._on_view(write_color(np.zeros((2, 3, 3), np.uint8), "base", Time()))
    assert client.shots[-1].tally == "0 of 0 in the boxes"
