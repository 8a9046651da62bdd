# SPDX-License-Identifier: Apache-2.0
"""What the policies refuse, and what they must not repeat."""

import numpy as np
import pytest

from neugrasp_ros.benchmark.planning import repeats
from neugrasp_ros.benchmark.policies import make_policy
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.geometry.transform import translation


def test_unknown_policy_is_refused_with_the_known_ones() -> None:
    with pytest.raises(
        UnknownNameError, match="geometry, neugrasp, oracle_local, oracle_s"
    ):
        make_policy("best", PlannerConfig())


def test_a_grasp_that_failed_is_not_repeated_and_others_are_kept() -> None:
    bad = translation(0.1, 0.1, 0.1)
    beside = translation(0.11, 0.1, 0.1)
    away = translation(0.15, 0.1, 0.1)
    from_elsewhere = bad.copy()
    from_elsewhere[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    poses = np.stack([bad, beside, away, from_elsewhere])
    np.testing.assert_array_equal(repeats(poses, (bad,)), [True, True, False, False])
    assert not repeats(poses, ()).any()
