# SPDX-License-Identifier: Apache-2.0
import logging

import numpy as np
import pytest

from neugrasp_ros.robot import seeds
from neugrasp_ros.robot.chain import chain_poses
from neugrasp_ros.robot.ik import IkProblem
from neugrasp_ros.robot.seeds import learn_arm, load_knowledge, wrist_centre


@pytest.fixture(scope="module")
def problem(robot):
    chain = robot.chain("arm_left_torso")
    weights = np.ones(len(chain.lower))
    return IkProblem(chain, chain.lower, chain.upper, weights, (1e-3, 5e-3), 40)


@pytest.fixture
def quick(monkeypatch):
    """Fewer samples: enough for a map with holes."""
    monkeypatch.setattr(seeds, "SAMPLES", 4000)


def test_the_wrist_centre_of_tiago_is_227_millimetres_behind_the_tcp(problem):
    # 66.6 mm behind the mounting face, which is 160.3 mm behind the TCP
    assert wrist_centre(problem.chain) == pytest.approx([-0.2269, 0, 0], abs=1e-4)


def test_the_last_three_joints_do_not_move_the_wrist_centre(problem, rng):
    wrist = wrist_centre(problem.chain)
    q = np.repeat(rng.uniform(problem.lower, problem.upper)[None], 20, axis=0)
    q[:, 5:] = rng.uniform(problem.lower[5:], problem.upper[5:], (20, 3))
    poses = chain_poses(problem.chain, q)
    points = poses[:, :3, :3] @ wrist + poses[:, :3, 3]
    assert np.ptp(points, axis=0).max() < 1e-6


def arrays(known):
    return [*known.table, *known[1:]]


def test_the_same_generator_gives_the_same_knowledge(problem, quick):
    first = learn_arm(problem, np.random.default_rng(1))
    second = learn_arm(problem, np.random.default_rng(1))
    for a, b in zip(arrays(first), arrays(second), strict=True):
        assert np.array_equal(a, b)


def test_stored_postures_are_inside_the_limits_and_do_not_reach_upwards(problem, quick):
    table = learn_arm(problem, np.random.default_rng(1)).table
    assert len(table.postures) > 500
    rounding = 1e-6
    assert np.all(table.postures >= problem.lower - rounding)
    assert np.all(table.postures <= problem.upper + rounding)
    assert table.turns[:, 6].max() < seeds.UPWARD  # z of the tip's x, its approach


def test_knowledge_is_stored_and_read_again(problem, quick, tmp_path, monkeypatch):
    first = load_knowledge(problem, tmp_path)
    monkeypatch.setattr(seeds, "learn_arm", None)  # reading must not work it out
    second = load_knowledge(problem, tmp_path)
    for a, b in zip(arrays(first), arrays(second), strict=True):
        assert np.array_equal(a, b)


def test_another_arm_has_knowledge_of_its_own(problem, quick, tmp_path):
    load_knowledge(problem, tmp_path)
    load_knowledge(problem._replace(upper=problem.upper - 0.1), tmp_path)
    assert len(list(tmp_path.glob("arm-*.npz"))) == 2


def test_a_damaged_file_is_replaced(problem, quick, tmp_path, caplog):
    load_knowledge(problem, tmp_path)
    (path,) = tmp_path.glob("arm-*.npz")
    path.write_bytes(b"nonsense")
    with caplog.at_level(logging.WARNING):
        load_knowledge(problem, tmp_path)
    assert "damaged" in caplog.text
    assert path.stat().st_size > 1000


def test_a_folder_that_cannot_be_written_is_no_obstacle(
    problem, quick, tmp_path, caplog
):
    (tmp_path / "file").touch()
    with caplog.at_level(logging.WARNING):
        known = load_knowledge(problem, tmp_path / "file" / "below")
    assert "cannot store" in caplog.text
    assert len(known.table.postures) > 500
