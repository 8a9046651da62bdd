# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.geometry.transform import make_transform  # noqa: E402
from neugrasp_ros.grasp.queries import parse_query  # noqa: E402
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList  # noqa: E402
from neugrasp_ros.nodes.selection import (  # noqa: E402
    describe,
    rank_scores,
    ranked,
    with_query,
)
from neugrasp_ros.nodes.settings import SelectionConfig  # noqa: E402

LABELS = ("cut", "pour")
CONFIG = SelectionConfig()


@pytest.fixture
def grasps() -> GraspList:
    """Three grasps, the higher the worse, far enough apart to be distinct."""
    positions = np.array([[0, 0, 0.1], [0.1, 0, 0.2], [0.2, 0, 0.3]])
    poses = make_transform(np.broadcast_to(np.eye(3), (3, 3, 3)), positions)
    scored = GraspSet(poses, np.full(3, 0.08)).with_scores(
        np.array([0.9, 0.8, 0.7]), np.array([[0.1, 0.2], [0.9, 0.9], [0.2, 1.0]])
    )
    return GraspList(GraspInfo(frame_id="base", labels=LABELS), scored)


@pytest.mark.parametrize(
    ("changes", "order"),
    [
        ({}, [1, 2, 0]),  # 0.18, 0.72, 0.70
        ({"affordance_weight": 0.0}, [0, 1, 2]),
        ({"affordance_weight": 2.0}, [2, 1, 0]),  # 0.036, 0.648, 0.70
        ({"rank_by": "quality"}, [0, 1, 2]),
        ({"rank_by": "affordance"}, [2, 1, 0]),
        ({"rank_by": "height"}, [2, 1, 0]),
    ],
)
def test_a_query_ranks_by_what_is_configured(grasps, changes, order):
    asked = with_query(grasps, parse_query("pour", LABELS))
    best = ranked(asked, replace(CONFIG, **changes))
    assert best.grasps.ids == tuple(grasps.grasps.ids[i] for i in order)


def test_without_a_query_the_quality_ranks(grasps):
    plain = with_query(grasps, parse_query("", LABELS))
    assert rank_scores(plain, CONFIG).tolist() == [0.9, 0.8, 0.7]


def test_the_answer_keeps_all_probabilities_and_the_query(grasps):
    asked = with_query(grasps, parse_query("cut&pour", LABELS))
    assert asked.info.query == "cut&pour"
    assert asked.affordance.tolist() == [0.1, 0.9, 0.2]
    assert asked.grasps.affordances.shape == (3, 2)


def test_of_two_that_are_nearly_the_same_the_better_stays(grasps):
    twins = replace(
        grasps, grasps=replace(grasps.grasps, poses=np.tile(np.eye(4), (3, 1, 1)))
    )
    assert ranked(twins, CONFIG).grasps.quality.tolist() == [0.9]
    nothing = grasps.take(np.zeros(3, dtype=bool))
    assert len(ranked(nothing, CONFIG)) == 0


def test_every_class_has_a_sentence():
    assert describe("pour") == "A grasp from which the content can be poured out."
    assert describe("sing") == "A grasp that affords sing."
