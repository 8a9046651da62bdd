# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from matplotlib.image import imread
from sim_shapes import block_set, looking_down

from neugrasp_ros.benchmark.album import SENTENCES, Album
from neugrasp_ros.benchmark.protocol import Plan, Suite, run_round
from neugrasp_ros.grasp.types import GraspSet
from sim_bridge.trial_result import FAILURES


def grasp_the_air(look, rng):
    poses = looking_down(0.15, 0.15, 0.3)[None]
    return Plan(GraspSet(poses, np.array([0.08]), np.array([0.5])))


@pytest.mark.slow
def test_every_failure_has_a_picture_and_its_reason_a_sentence(tmp_path):
    assert set(SENTENCES) == set(FAILURES)
    suite = Suite(scene="packed", objects="blocks", part="all", count=1)
    record = run_round(
        suite, 3, grasp_the_air, Album(tmp_path), {"blocks": block_set()}
    )
    assert len(record.attempts) == 2
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["round_003_0_empty.png", "round_003_1_empty.png"]
    assert imread(tmp_path / names[0]).shape[1] > 1000
