# SPDX-License-Identifier: Apache-2.0
"""Grasps to be labelled: good ones, random ones, and near misses.

In: the true surface of a scene. Out: poses, each with where it came from. A third of
the sampler's own grasps would be enough to learn what works; what fails is learned
from random antipodal grasps and from grasps that were moved a little.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import canonical_gripper, make_transform
from neugrasp_ros.grasp.collision import approach_is_free, support_clearance
from neugrasp_ros.grasp.hypotheses import choose_seeds, facing_contacts, hands_around
from neugrasp_ros.grasp.sampling import SamplerConfig, sample_candidates

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SOURCES = ("sampler", "antipodal", "jitter", "near_miss", "chosen")
DRAWN = SOURCES[:4]  # the others are chosen by a network, see ``chosen``
SIDE_COSINE = 0.5  # an approach more than 60 degrees from straight down is a side grasp


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateConfig:
    """How many grasps of which kind are drawn for a scene.

    Attributes:
        n_trials: Grasps meant for the physics.
        n_collisions: Grasps whose pre-grasp already collides: labelled, not tried.
        shares: Of ``DRAWN`` among ``n_trials``, adding up to 1.
        side_share: Least share of side grasps that is asked for in each source.
        n_points: Surface points drawn.
        max_approach_z: Greatest z of the approach direction [-]: a little from below,
            since a network must know that too.
        table_overlap: How far a hand may cut the table in [m]: noise does that to the
            best candidates.
        tilt: Standard deviation of the jitter's rotation vector per axis in [rad].
        offset: The same of its translation in [m].
        contact_angle: Greatest angle between two contacts' normals in [rad].
        pregrasp_distance: Length of the approach in [m].
        half_open_share: Of grasps that approach with jaws less than fully open.
        least_opening: How far those are open at least, as a share of the full opening.
    """

    n_trials: int = 30
    n_collisions: int = 12
    shares: tuple[float, float, float, float] = (0.25, 0.40, 0.20, 0.15)
    side_share: float = 0.35
    n_points: int = 8000
    max_approach_z: float = 0.1
    table_overlap: float = 0.002
    tilt: float = 0.25
    offset: float = 0.009
    contact_angle: float = 0.9
    pregrasp_distance: float = 0.05
    half_open_share: float = 0.25
    least_opening: float = 0.4


class Candidates(NamedTuple):
    """Grasps to be labelled.

    Attributes:
        poses: ``T_task_gripper``, shape (G, 4, 4).
        openings: Jaw opening on approach in [m], shape (G,).
        sources: Index into ``SOURCES``, shape (G,).
        blocked: True where the pre-grasp collides by geometry, shape (G,).
    """

    poses: FloatArray
    openings: FloatArray
    sources: NDArray[np.uint8]
    blocked: BoolArray


def is_side(T_task_gripper: FloatArray) -> BoolArray:
    """Tell which approach directions are more than 60 degrees from straight down."""
    return np.asarray(T_task_gripper[..., 2, 2] > -SIDE_COSINE)


def draw_candidates(
    meshes: MeshScene,
    gripper: Gripper,
    support_height: float,
    config: CandidateConfig,
    rng: np.random.Generator,
) -> Candidates:
    """Draw grasps on the true surface of a scene.

    Args:
        meshes: The scene's objects, without the table.
        gripper: The hand.
        support_height: Height of the table top in the task frame in [m].
        config: Numbers and kinds.
        rng: Source of randomness.

    Returns:
        At most ``n_trials`` grasps that can be tried and ``n_collisions`` that cannot,
        in random order.
    """
    points, normals, _ = meshes.sample_surface(config.n_points, rng)
    cloud = np.concatenate([points, normals], axis=1)
    good = sample_candidates(
        points, normals, gripper, SamplerConfig(), rng, support_height=support_height
    ).poses
    pairs = _random_antipodal(cloud, gripper, config, rng)
    seeds = np.concatenate([good, pairs])
    pools = (good, pairs, _jittered(seeds, config, rng), _near_misses(seeds, rng))
    picked, opened = [np.zeros((0, 4, 4))], [np.zeros(0)]
    sources = [np.zeros(0, dtype=np.uint8)]
    blocked = [np.zeros(0, dtype=bool)]
    for source, pool in enumerate(pools):
        pool = pool[_is_sensible(pool, gripper, support_height, config)]
        pool = pool[rng.permutation(len(pool))[: 20 * config.n_trials]]
        openings = _draw_openings(len(pool), gripper, config, rng)
        is_blocked = ~_pregrasp_is_free(pool, openings, points, gripper, config)
        for wanted in (False, True):
            number = config.n_collisions if wanted else config.n_trials
            rows = np.flatnonzero(is_blocked == wanted)
            count = number * config.shares[source]
            rows = _pick(pool, rows, _round(count, rng), config.side_share)
            picked.append(pool[rows])
            opened.append(openings[rows])
            sources.append(np.full(len(rows), source, dtype=np.uint8))
            blocked.append(np.full(len(rows), wanted))
    order = rng.permutation(sum(len(p) for p in picked))
    return Candidates(
        canonical_gripper(np.concatenate(picked)[order]),
        np.concatenate(opened)[order],
        np.concatenate(sources)[order],
        np.concatenate(blocked)[order],
    )


def _round(value: float, rng: np.random.Generator) -> int:
    """Round up or down at random, right on average."""
    return int(value + rng.random())


def _pick(pool: FloatArray, rows: IntArray, count: int, side_share: float) -> IntArray:
    """Take the first rows, but at least ``side_share`` side grasps if there are."""
    sides = rows[is_side(pool[rows])]
    tops = rows[~is_side(pool[rows])]
    n_sides = min(len(sides), int(np.ceil(side_share * count)))
    chosen = np.concatenate([sides[:n_sides], tops[: count - n_sides]])
    return np.concatenate([chosen, sides[n_sides : n_sides + count - len(chosen)]])


def _is_sensible(
    poses: FloatArray, gripper: Gripper, support_height: float, config: CandidateConfig
) -> BoolArray:
    openings = np.full(len(poses), gripper.max_opening)
    height = support_clearance(poses, openings, gripper, support_height)
    from_above = poses[:, 2, 2] <= config.max_approach_z
    return np.asarray((height > -config.table_overlap) & from_above)


def _draw_openings(
    count: int, gripper: Gripper, config: CandidateConfig, rng: np.random.Generator
) -> FloatArray:
    shares = rng.uniform(config.least_opening, 1.0, size=count)
    is_full = rng.random(count) >= config.half_open_share
    return gripper.max_opening * np.where(is_full, 1.0, shares)


def _pregrasp_is_free(
    poses: FloatArray,
    openings: FloatArray,
    points: FloatArray,
    gripper: Gripper,
    config: CandidateConfig,
) -> BoolArray:
    pregrasps = poses.copy()
    pregrasps[:, :3, 3] -= config.pregrasp_distance * poses[:, :3, 2]
    return approach_is_free(
        pregrasps, openings, points, gripper, inflation=0.001, retreat=0.0
    )


def _random_antipodal(
    cloud: FloatArray,
    gripper: Gripper,
    config: CandidateConfig,
    rng: np.random.Generator,
) -> FloatArray:
    """Close along lines between facing contacts, from random sides, at random depth."""
    seeds = choose_seeds(cloud[:, :3], 160, rng)
    pairs = facing_contacts(
        cloud, seeds, gripper.max_opening, 0.012, config.contact_angle
    )
    poses = hands_around(pairs.middles, pairs.axes, 16, rng).reshape(-1, 4, 4)
    depths = rng.uniform(0.002, 0.95 * gripper.finger_depth, size=(len(poses), 1))
    poses[:, :3, 3] += depths * poses[:, :3, 2]
    poses[:, :3, 3] += rng.normal(0.0, 0.003, size=(len(poses), 1)) * poses[:, :3, 0]
    return poses


def _moved(poses: FloatArray, vectors: FloatArray, shifts: FloatArray) -> FloatArray:
    """Turn and shift grasps in their own frames about a point between the pads."""
    step = make_transform(Rotation.from_rotvec(vectors).as_matrix(), shifts)
    return np.asarray(poses @ step)


def _jittered(
    poses: FloatArray, config: CandidateConfig, rng: np.random.Generator
) -> FloatArray:
    base = poses[rng.integers(len(poses), size=min(len(poses), 1) * 600)]
    vectors = rng.normal(0.0, config.tilt, size=(len(base), 3))
    return _moved(base, vectors, rng.normal(0.0, config.offset, size=(len(base), 3)))


def _near_misses(poses: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Spoil grasps in one way each: beside, turned in the jaws' plane, too shallow."""
    base = poses[rng.integers(len(poses), size=min(len(poses), 1) * 600)]
    kind = rng.integers(3, size=len(base))
    sign = rng.choice([-1.0, 1.0], size=len(base))
    vectors, shifts = np.zeros((len(base), 3)), np.zeros((len(base), 3))
    shifts[:, 1] = np.where(kind == 0, sign * rng.uniform(0.008, 0.03, len(base)), 0.0)
    vectors[:, 0] = np.where(kind == 1, sign * rng.uniform(0.3, 0.8, len(base)), 0.0)
    shifts[:, 2] = np.where(kind == 2, -rng.uniform(0.005, 0.03, len(base)), 0.0)
    return _moved(base, vectors, shifts)
