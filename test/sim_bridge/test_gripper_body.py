# SPDX-License-Identifier: Apache-2.0
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.gripper import load_gripper
from sim_bridge.gripper_body import write_gripper_urdf


@pytest.mark.parametrize(
    ("opening", "advance"),
    [(0.085, 0.0), (0.0656, 0.0064), (0.0438, 0.0108), (0.0207, 0.0131)],
)
def test_the_tip_advance_follows_the_linkage_of_the_2f85(opening, advance):
    gripper = load_gripper("robotiq_2f85")
    assert abs(tip_advance_at(gripper, opening) - advance) < 4e-4


def test_parallel_jaws_do_not_advance():
    gripper = load_gripper("panda")
    assert tip_advance_at(gripper, 0.0) == tip_advance_at(gripper, 0.08) == 0.0


@pytest.mark.parametrize(("name", "n_joints"), [("panda", 2), ("robotiq_2f85", 3)])
def test_the_urdf_has_the_boxes_and_strokes_of_the_gripper(tmp_path, name, n_joints):
    gripper = load_gripper(name)
    write_gripper_urdf(gripper, tmp_path / "hand.urdf")
    root = ET.parse(tmp_path / "hand.urdf").getroot()
    assert len(root.findall("joint")) == n_joints
    _, half_extents = gripper.boxes()
    for link, half in zip(("left", "right", "hand"), half_extents, strict=True):
        box = root.find(f"link[@name='{link}']/collision/geometry/box")
        np.testing.assert_allclose(
            [float(v) for v in box.get("size").split()], 2 * half
        )
    for side in ("left", "right"):
        limit = root.find(f"joint[@name='{side}']/limit")
        assert float(limit.get("upper")) == gripper.max_opening / 2
