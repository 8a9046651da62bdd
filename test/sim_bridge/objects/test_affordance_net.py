# SPDX-License-Identifier: Apache-2.0
import os
import pickle

import numpy as np
import pytest

from neugrasp_ros.errors import ObjectFileError
from sim_bridge.objects.affordance_net import (
    HUMAN_CLASSES,
    LabelledShape,
    read_affordance_net,
    robot_scores,
)
from sim_bridge.objects.affordances import AFFORDANCE_NAMES


def entry(n=6, category="Knife", **labels):
    scores = {name: np.zeros((n, 1), dtype=np.float32) for name in HUMAN_CLASSES}
    for name, values in labels.items():
        scores[name] = np.array(values, dtype=np.float32).reshape(n, 1)
    points = np.arange(3 * n, dtype=np.float32).reshape(n, 3)
    return {
        "shape_id": "abc",
        "semantic class": category,
        "affordance": list(labels),
        "full_shape": {"coordinate": points, "label": scores},
    }


def write(path, content, protocol=4):
    path.write_bytes(pickle.dumps(content, protocol=protocol))
    return path


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_shapes_come_back_with_18_scores_per_point(tmp_path, protocol):
    grasp = [0.9, 0.5, 0, 0, 0, 0]
    path = write(tmp_path / "full.pkl", [entry(grasp=grasp), entry()], protocol)
    one, two = read_affordance_net(path)
    assert (one.shape_id, one.category) == ("abc", "Knife")
    assert one.points.shape == (6, 3)
    assert one.scores.shape == (6, 18)
    np.testing.assert_allclose(one.scores[:, 0], grasp, atol=1e-6)
    assert two.scores.sum() == 0.0


def test_robot_gives_by_the_blade_and_cuts_by_the_handle():
    scores = np.zeros((2, 18))
    scores[0, HUMAN_CLASSES.index("grasp")] = 0.8
    scores[1, HUMAN_CLASSES.index("cut")] = 0.6
    scores[1, HUMAN_CLASSES.index("stab")] = 0.7
    robot = robot_scores(LabelledShape("a", "Knife", np.zeros((2, 3)), scores))
    by_name = dict(zip(AFFORDANCE_NAMES, robot.T, strict=True))
    np.testing.assert_allclose(by_name["cut"], [0.8, 0])
    np.testing.assert_allclose(by_name["stab"], [0.8, 0])
    np.testing.assert_allclose(by_name["handover"], [0, 0.7])
    assert by_name["pour"].sum() == 0


def test_category_beyond_ours_affords_nothing():
    shape = LabelledShape("a", "Chair", np.zeros((3, 3)), np.ones((3, 18)))
    assert robot_scores(shape).sum() == 0.0


class Runs:
    def __reduce__(self):
        return (os.system, ("touch never",))


def test_pickle_that_would_run_something_is_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path / "evil.pkl", [Runs()])
    with pytest.raises(ObjectFileError, match="system is not allowed"):
        read_affordance_net(path)
    assert not (tmp_path / "never").exists()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"a": 1}, "expected a list, got dict"),
        ([1], "entry 0 is not a labelled shape"),
        ([{"shape_id": "a"}], "entry 0 is not a labelled shape.*full_shape"),
        ([entry(grasp=[1, 0, 0, 0, 0, 0]), entry(4) | {"full_shape": 3}], "entry 1"),
        (
            [entry() | {"full_shape": {"coordinate": [[1, 2]], "label": {}}}],
            r"\(N, 3\)",
        ),
        (
            [
                entry()
                | {"full_shape": {"coordinate": [[1, 2, 3]], "label": {"fly": [1]}}}
            ],
            "entry 0",
        ),
    ],
)
def test_other_structures_are_refused(tmp_path, content, message):
    with pytest.raises(ObjectFileError, match=message):
        read_affordance_net(write(tmp_path / "x.pkl", content))


def test_missing_and_truncated_files_are_refused(tmp_path):
    with pytest.raises(ObjectFileError, match="cannot be read"):
        read_affordance_net(tmp_path / "none.pkl")
    whole = pickle.dumps([entry()])
    (tmp_path / "half.pkl").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ObjectFileError, match="is no pickle of plain arrays"):
        read_affordance_net(tmp_path / "half.pkl")
