# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from builtin_interfaces.msg import Time  # noqa: E402

from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.nodes.compat.tf import Buffer, to_transform  # noqa: E402
from neugrasp_ros.nodes.markers import LabelledBox, box_markers  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.solid_boxes import KnownBoxes  # noqa: E402
from neugrasp_ros.nodes.transforms import Transforms  # noqa: E402

SIZE = np.array([0.6, 0.8, 0.03])
SECOND = 10**9


def table(T_frame_box=None, frame="map"):
    T = translation(0.2, 0.0, 0.7) if T_frame_box is None else T_frame_box
    return box_markers([LabelledBox("table", T, SIZE)], frame, Time())


@pytest.fixture
def buffer():
    return Buffer()


@pytest.fixture
def boxes(buffer):
    return KnownBoxes("base", Transforms(buffer))


def drive(buffer: Buffer, x: float, second: int) -> None:
    place = to_transform(translation(x, 0.0, 0.0), "map", "base", second * SECOND)
    buffer.set_transform(place, "")


def test_boxes_stay_where_they_are_while_the_base_drives(boxes, buffer):
    boxes.remember(table())
    for second, x in ((1, -1.0), (2, -0.5)):
        drive(buffer, x, second)
        (box,) = boxes.in_base()
        assert box.T_base_box == pytest.approx(translation(0.2 - x, 0.0, 0.7))
        assert box.size == pytest.approx(SIZE)


def test_boxes_that_come_before_the_first_transform_are_not_lost(boxes, buffer):
    boxes.remember(table())
    with pytest.raises(DetectionError, match="collision_boxes: base <- map: ") as told:
        boxes.in_base()
    assert told.value.code == Code.TF_ERROR
    drive(buffer, 0.0, 1)
    assert len(boxes.in_base()) == 1


def test_boxes_of_the_base_itself_need_no_transform(boxes):
    boxes.remember(table(np.eye(4), "base"))
    assert boxes.in_base()[0].T_base_box == pytest.approx(np.eye(4))


def test_an_empty_message_clears(boxes):
    boxes.remember(table())
    boxes.remember(box_markers([], "map", Time()))
    assert boxes.in_base() == ()


def bent():
    message = table()
    message.markers[-1].pose.orientation.w = 2.0
    return message


def flat():
    sheet = LabelledBox("table", np.eye(4), np.array([1.0, 1.0, 0.0]))
    return box_markers([sheet], "map", Time())


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (flat(), "'table': edges must be > 0"),
        (table(frame=""), "'table': its frame id is empty"),
        (bent(), "'table': a quaternion has length 2"),
    ],
)
def test_a_bad_message_is_refused_at_once_and_earlier_boxes_stay(
    boxes, message, sentence
):
    boxes.remember(table(frame="base"))
    with pytest.raises(ConfigError, match=sentence):
        boxes.remember(message)
    assert len(boxes.in_base()) == 1
