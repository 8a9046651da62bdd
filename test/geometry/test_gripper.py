# SPDX-License-Identifier: Apache-2.0
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import yaml

from neugrasp_ros.errors import ConfigError, UnknownNameError
from neugrasp_ros.geometry.gripper import (
    Gripper,
    gripper_from,
    gripper_names,
    load_gripper,
    varied_gripper,
)

MEASURES = {
    "name": "wide",
    "max_opening": 0.11,
    "finger_depth": 0.06,
    "finger_thickness": 0.02,
    "finger_width": 0.01,
    "palm_size": [0.06, 0.2, 0.09],
    "mount_to_tcp": 0.15,
    "max_force": 30.0,
    "tip_advance": 0.01,
}


@pytest.fixture
def written(tmp_path):
    """Write measures, changed as told, and return the file."""

    def write(drop: str = "", **changes) -> str:
        values = {k: v for k, v in (MEASURES | changes).items() if k != drop}
        path = tmp_path / "wide.yaml"
        path.write_text(yaml.safe_dump(values))
        return str(path)

    return write


@pytest.mark.parametrize("name", ["panda", "robotiq_2f85"])
def test_shipped_grippers_load_under_their_names(name):
    assert name in gripper_names()
    assert load_gripper(name).name == name


def test_the_example_of_a_users_gripper_loads():
    gripper = load_gripper(str(Path(__file__).parents[2] / "docs/wide_gripper.yaml"))
    assert (gripper.name, gripper.max_opening) == ("wide_110", 0.11)


def test_a_users_file_round_trips(written):
    gripper = load_gripper(written())
    assert asdict(gripper) == MEASURES | {"palm_size": tuple(MEASURES["palm_size"])}


def test_a_parallel_slide_needs_no_tip_advance(written):
    assert load_gripper(written(drop="tip_advance")).tip_advance == 0.0


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"colour": "red"}, r"unknown \['colour'\]; known: .*finger_depth"),
        ({"drop": "finger_width"}, r"missing \['finger_width'\]"),
        ({"finger_depth": -0.05}, r"finger_depth must be in \(0, 1\] m, got -0.05"),
        ({"max_opening": 85}, "max_opening"),  # in millimetres by mistake
        ({"max_opening": float("nan")}, "max_opening"),
        ({"max_opening": "wide"}, "wide.yaml"),
        ({"palm_size": [0.1, 0.1]}, "palm_size: expected x, y, z"),
        ({"palm_size": [0.1, 0.1, 0.0]}, r"palm_size\[2\]"),
        ({"palm_size": ["a", "b", "c"]}, "wide.yaml"),
        ({"palm_size": 0.1}, "wide.yaml"),
        ({"max_force": 0}, "max_force must be positive"),
        ({"tip_advance": -0.001}, "tip_advance must be in"),
        ({"tip_advance": 0.07}, "tip_advance must be in"),
    ],
)
def test_a_wrong_measure_is_named(written, changes, told):
    with pytest.raises(ConfigError, match=told):
        load_gripper(written(**changes))


@pytest.mark.parametrize("text", ["- a list", "name: [", "just words"])
def test_a_file_that_is_no_mapping_is_rejected(tmp_path, text):
    path = tmp_path / "g.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match="g.yaml"):
        load_gripper(path)


@pytest.mark.parametrize("name", ["barrett", "missing.yaml"])
def test_an_unknown_gripper_is_answered_with_the_known_ones(name):
    with pytest.raises(UnknownNameError, match=f"gripper '{name}'.*panda"):
        load_gripper(name)


def test_boxes_touch_the_opening_the_palm_plane_and_the_tips():
    gripper = Gripper(**MEASURES)
    centers, halves = gripper.boxes()
    lower, upper = centers - halves, centers + halves
    assert lower[0, 1] == pytest.approx(0.055)  # left pad face
    assert upper[1, 1] == pytest.approx(-0.055)
    assert upper[:2, 2] == pytest.approx(0.0)  # tips are at the TCP
    assert lower[:2, 2] == pytest.approx(-0.06)
    assert upper[2, 2] == pytest.approx(-0.06)  # palm front plane
    np.testing.assert_allclose(2 * halves[2], MEASURES["palm_size"])


def test_closing_moves_the_fingers_only():
    gripper = Gripper(**MEASURES)
    open_centers, halves = gripper.boxes()
    closed_centers, closed_halves = gripper.boxes(0.0)
    assert (closed_centers - halves)[0, 1] == pytest.approx(0.0)
    np.testing.assert_array_equal(closed_halves, halves)
    np.testing.assert_array_equal(closed_centers[2], open_centers[2])


def test_a_gripper_can_be_a_key():
    assert {Gripper(**MEASURES): 1}[Gripper(**MEASURES)] == 1


def test_varied_grippers_are_drawn_anew_and_survive_their_plain_values():
    rng = np.random.default_rng(0)
    drawn = [varied_gripper(rng) for _ in range(20)]
    assert len({gripper.max_opening for gripper in drawn}) == 20
    for gripper in drawn:
        assert 0.05 <= gripper.max_opening <= 0.14
        plain = json.loads(json.dumps(asdict(gripper)))
        assert gripper_from(plain, "here") == gripper
