# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from builtin_interfaces.msg import Time  # noqa: E402

from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.geometry.transform import translation  # noqa: E402
from neugrasp_ros.nodes.markers import LabelledBox, box_markers  # noqa: E402
from neugrasp_ros.nodes.solid_boxes import from_box_markers  # noqa: E402

SIZE = np.array([0.6, 0.8, 0.03])


def shifted(target, source, stamp):
    assert (target, source) == ("base", "map")
    return translation(1.0, 0.0, 0.0)


def test_cubes_become_boxes_in_the_base_frame():
    table = LabelledBox("table", translation(0.2, 0.0, 0.7), SIZE)
    (box,) = from_box_markers(box_markers([table], "map", Time()), "base", shifted)
    assert box.T_base_box == pytest.approx(translation(1.2, 0.0, 0.7))
    assert box.size == pytest.approx(SIZE)


def test_an_empty_message_clears_and_a_flat_box_is_refused():
    assert from_box_markers(box_markers([], "map", Time()), "base", shifted) == ()
    flat = LabelledBox("sheet", np.eye(4), np.array([1.0, 1.0, 0.0]))
    with pytest.raises(ConfigError, match="'sheet': edges must be > 0"):
        from_box_markers(box_markers([flat], "map", Time()), "base", shifted)
