# SPDX-License-Identifier: Apache-2.0
"""What the policies refuse, and what they must not repeat."""

import numpy as np
import pytest

from neugrasp_ros.benchmark.planning import repeats, worth_trying
from neugrasp_ros.benchmark.policies import make_policy
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.types import GraspSet


def test_unknown_policy_is_refused_with_the_known_ones() -> None:
    with pytest.raises(
        UnknownNameError, match="geometry, neugrasp, no_scene_render, oracle_candidates"
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


def test_only_good_grasps_are_tried_and_another_object_first_after_a_failure() -> None:
    places = [translation(x, 0.1, 0.1) for x in (0.10, 0.14, 0.25, 0.20)]
    scored = GraspSet(np.stack(places), np.full(4, 0.08)).with_scores(
        np.array([0.9, 0.95, 0.8, 0.4])
    )
    assert worth_trying(scored, ()).quality.tolist() == [0.95, 0.9, 0.8]
    after = worth_trying(scored, (places[1],))
    assert after.quality.tolist() == [0.8, 0.95, 0.9]
    assert worth_trying(scored, (places[1],) * 2).quality.tolist() == [0.8]
