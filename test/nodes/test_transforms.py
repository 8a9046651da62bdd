# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.nodes.compat.tf import Buffer, to_transform  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.transforms import Transforms  # noqa: E402

SECOND = 10**9


@pytest.fixture
def transforms():
    buffer = Buffer()
    for second in (1, 2):
        T = translation(float(second), 0.0, 0.0)
        buffer.set_transform(to_transform(T, "base", "hand", second * SECOND), "")
    return Transforms(buffer)


def test_a_frame_is_itself_whether_it_is_known_or_not(transforms):
    assert transforms("moon", "moon", 0) == pytest.approx(np.eye(4))


def test_zero_is_the_newest_time_and_others_are_looked_up(transforms):
    assert transforms("base", "hand", 0)[0, 3] == pytest.approx(2.0)
    assert transforms("base", "hand", 3 * SECOND // 2)[0, 3] == pytest.approx(1.5)
    assert transforms("hand", "base", SECOND)[0, 3] == pytest.approx(-1.0)


def test_a_missing_link_is_named(transforms):
    with pytest.raises(DetectionError, match="^base <- moon: ") as caught:
        transforms("base", "moon", 0)
    assert caught.value.code is Code.TF_ERROR
    assert transforms.frames() == ("base", "hand")
