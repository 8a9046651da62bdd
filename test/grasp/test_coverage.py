# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.collision import approach_is_free
from neugrasp_ros.grasp.coverage import bare_points, propose_everywhere
from neugrasp_ros.grasp.ranking import distinct
from neugrasp_ros.grasp.sampling import Proposals, SamplerConfig, propose

TABLE = 0.05
PANDA = load_gripper("panda")
FEW = SamplerConfig(n_seeds=4)
PLACES = np.stack(np.meshgrid([0.1, 0.3, 0.5, 0.7], [0.1, 0.3, 0.5]), -1).reshape(-1, 2)


@pytest.fixture(scope="module")
def table():
    """Twelve boxes of different heights, a hand's breadth and more apart."""
    halves = [np.array([0.02, 0.03, 0.012 + 0.002 * n]) for n in range(len(PLACES))]
    poses = [
        translation(*xy, TABLE + h[2]) for h, xy in zip(halves, PLACES, strict=True)
    ]
    scene = MeshScene([box_mesh(half) for half in halves], np.stack(poses))
    points, normals, _ = scene.sample_surface(900, np.random.default_rng(1))
    return points, normals


def beside(found: Proposals) -> np.ndarray:
    gaps = np.linalg.norm(found.poses[:, None, :2, 3] - PLACES, axis=2)
    return (gaps < 0.06).sum(axis=0)


def test_few_seeds_leave_boxes_bare_and_a_second_round_does_not(table):
    rng = np.random.default_rng(0)
    first = propose(*table, PANDA, FEW, rng, support_height=TABLE)
    assert (beside(first) == 0).any()
    rng = np.random.default_rng(0)
    every = propose_everywhere(*table, PANDA, FEW, rng, support_height=TABLE)
    assert (beside(every) > 0).all()
    openings = np.full(len(every.poses), PANDA.max_opening)
    free = approach_is_free(every.poses, openings, table[0], PANDA, 0.0)
    assert free.mean() > 0.97  # the sampler looks at one point per 5 mm cell
    assert len(distinct(*every[:2], FEW.distance, FEW.angle)) == len(every.poses)


def test_what_has_proposals_everywhere_is_not_tried_again(table):
    rng = np.random.default_rng(0)
    usual = SamplerConfig(n_seeds=256)
    once = propose(*table, PANDA, usual, rng, support_height=TABLE)
    assert not bare_points(table[0], once, TABLE).any()
    rng = np.random.default_rng(0)
    every = propose_everywhere(*table, PANDA, usual, rng, support_height=TABLE)
    np.testing.assert_array_equal(every.poses, once.poses)


def test_a_larger_surface_gets_more_seeds(table):
    twice = [np.tile(part, (4, 1)) for part in table]
    rng = np.random.default_rng(0)
    once = propose(*twice, PANDA, SamplerConfig(), rng, support_height=TABLE)
    rng = np.random.default_rng(0)
    every = propose_everywhere(
        *twice, PANDA, SamplerConfig(), rng, support_height=TABLE
    )
    assert len(every.poses) > 1.5 * len(once.poses)


def test_points_far_from_proposals_are_bare_unless_they_are_the_support():
    points = np.array(
        [[0.1, 0.1, 0.1], [0.13, 0.1, 0.3], [0.2, 0.1, 0.1], [0.3, 0, 0.05]]
    )
    found = Proposals(translation(0.1, 0.1, 0.1)[None], np.ones(1), np.ones(1))
    assert bare_points(points, found, TABLE).tolist() == [False, False, True, False]
    assert bare_points(points, found, None).tolist() == [False, False, True, True]
    nothing = found.take(np.zeros(1, dtype=bool))
    assert bare_points(points, nothing, TABLE).tolist() == [True, True, True, False]


def test_nothing_seen_gives_nothing():
    empty = np.zeros((0, 3))
    rng = np.random.default_rng(0)
    assert not len(propose_everywhere(empty, empty, PANDA, FEW, rng).poses)
