# SPDX-License-Identifier: Apache-2.0
"""Propose grasps on a surface from all sides that a hand can come from.

In: surface points with outward normals in the task frame (z up), a gripper.
Out: a ``GraspSet`` of distinct, collision-free candidates spread over the surface.

Two families of oriented hands are tried. *Surface* hands come along the inward normal
of a seed point, tilted to all sides, with the jaws turned over half a turn, and centre
themselves on what stands between them. *Antipodal* hands close along the line between
two facing contacts and come from all around that line. Each hand then advances as far
as the cloud, the palm and the support plane allow, and is proposed at several depths.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, ShapeError
from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import canonical_gripper
from neugrasp_ros.grasp.collision import (
    approach_is_free,
    hand_measures,
    support_clearance,
)
from neugrasp_ros.grasp.hypotheses import (
    choose_seeds,
    facing_contacts,
    hands_around,
    hands_onto,
    thin,
)
from neugrasp_ros.grasp.jaw_sweep import SweepSettings, jaw_content, sweep_depths
from neugrasp_ros.grasp.ranking import distinct, spread
from neugrasp_ros.grasp.types import GraspSet

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SEED_RADIUS = 0.08  # [m] what is further from a seed is left to the final check
REGION = 0.03  # [m] edge of the regions that take turns in giving candidates
DEPTH_BONUS = 0.1  # more inside the jaws holds better, all else being equal
NARROW_PENALTY = 0.3  # fits only with half-closed jaws
MAX_CONTACT_ANGLE = 0.7  # [rad] two pads of friction 1 hold up to 45 degrees each


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplerConfig:
    """How densely grasps are tried and what makes one acceptable.

    Attributes:
        max_candidates: How many grasps to return at most.
        n_seeds: Surface points around which hands are tried.
        n_yaws: Steps of the jaws over half a turn, around a surface normal.
        n_rolls: Steps of the approach over a whole turn, around a closing axis.
        tilt_step: Tilt from the surface normal, once and twice, in [rad].
        depth_fractions: Depths to propose: 0 = least insertion, 1 = furthest advance.
        max_approach_z: Greatest z of the approach direction [-]; 0 = level, so nothing
            comes from below.
        voxel: The cloud is thinned to one point per voxel of this edge, in [m].
        inflation: Added to the sides of the hand in [m]; half a voxel, and physics
            surfaces are up to 2 mm fatter than they look.
        palm_gap: Distance that the palm keeps from the object in [m].
        min_insertion: Least overlap of the pads with the object along z in [m]; half of
            it will do where nothing else is possible.
        width_margin: Free way of each pad before it touches in [m].
        clearance: Height of the hand above the support plane in [m].
        min_clearance: The same where nothing else is possible, in [m].
        retreat: Distance of the pre-grasp behind the grasp in [m].
        min_alignment: Least mean cosine between closing direction and surface normal,
            of the worse pad [-]. In physics trials 90 % held above 0.6, half below.
        one_sided: Accept grasps one of whose contacts is not seen: for clouds that
            are not completed.
        half_closed: Also propose what can be approached only with the jaws closed to
            the grasp's width; else every grasp can be approached fully open.
        distance: Grasps nearer than this, and than ``angle``, are the same; in [m].
        angle: See ``distance``; in [rad].
        threads: Worker threads; they change nothing but the time.
    """

    max_candidates: int = 256
    n_seeds: int = 64
    n_yaws: int = 6
    n_rolls: int = 16
    tilt_step: float = 0.33
    depth_fractions: tuple[float, ...] = (1.0, 0.45)
    max_approach_z: float = 0.02
    voxel: float = 0.005
    inflation: float = 0.002
    palm_gap: float = 0.004
    min_insertion: float = 0.006
    width_margin: float = 0.008
    clearance: float = 0.002
    min_clearance: float = 0.0
    retreat: float = 0.10
    min_alignment: float = 0.5
    one_sided: bool = False
    half_closed: bool = False
    distance: float = 0.02
    angle: float = 0.35
    threads: int = 1

    def __post_init__(self) -> None:
        """Reject values out of range.

        Raises:
            ConfigError: If a count, length or angle is not positive, or a fraction or
                cosine not in [0, 1].
        """
        for name in ("max_candidates", "n_seeds", "n_yaws", "n_rolls", "voxel",
                     "min_insertion", "distance", "angle", "threads"):  # fmt: skip
            if not getattr(self, name) > 0:
                raise ConfigError(f"{name} must be positive, got {getattr(self, name)}")
        shares = (*self.depth_fractions, self.min_alignment)
        if not self.depth_fractions or not all(0 <= s <= 1 for s in shares):
            raise ConfigError(
                "depth_fractions and min_alignment must be in [0, 1], got "
                f"{self.depth_fractions}, {self.min_alignment}"
            )

    def tilts(self) -> FloatArray:
        """Return the tilts as rotation vectors in the hand's frame, shape (7, 3)."""
        about_y = self.tilt_step * np.array([-2, -1, 0, 1, 2])
        tilts = np.zeros((7, 3))
        tilts[:5, 1] = about_y
        tilts[5:, 0] = self.tilt_step * np.array([-1, 1])
        return tilts


class _Hands(NamedTuple):
    """Oriented hands at advance 0, grouped by seed."""

    poses: FloatArray  # (F, 4, 4)
    seeds: IntArray  # (F,)
    centered: BoolArray  # (F,)


class Proposals(NamedTuple):
    """Candidates on their way to a grasp set.

    Attributes:
        poses: ``T_task_gripper``, shape (G, 4, 4).
        scores: Higher is preferred, shape (G,).
        widths: Jaw openings that leave ``width_margin`` to both sides, shape (G,).
    """

    poses: FloatArray
    scores: FloatArray
    widths: FloatArray

    def take(self, rows: BoolArray | IntArray) -> "Proposals":
        """Return those at rows (integers in order, or a mask)."""
        return Proposals(self.poses[rows], self.scores[rows], self.widths[rows])


def sample_candidates(
    points: FloatArray,
    normals: FloatArray,
    gripper: Gripper,
    config: SamplerConfig,
    rng: np.random.Generator,
    *,
    support_height: float | None = None,
    obstacles: FloatArray | None = None,
) -> GraspSet:
    """Propose grasps on a surface and choose among them.

    Args:
        points: As of ``propose``, like the others.
        normals: Outward unit normals.
        gripper: The hand.
        config: Density and limits.
        rng: Source of randomness.
        support_height: Height of the support.
        obstacles: More points that the hand must not touch.

    Returns:
        At most ``max_candidates`` distinct grasps, not scored, as ``choose`` orders
        them. Empty if nothing fits.

    Raises:
        ShapeError: If points and normals are not both (N, 3).
    """
    found = propose(
        points, normals, gripper, config, rng,
        support_height=support_height, obstacles=obstacles,
    )  # fmt: skip
    return choose(found, config.max_candidates)


def propose(
    points: FloatArray,
    normals: FloatArray,
    gripper: Gripper,
    config: SamplerConfig,
    rng: np.random.Generator,
    *,
    support_height: float | None = None,
    obstacles: FloatArray | None = None,
) -> Proposals:
    """Propose grasps on a surface.

    Args:
        points: Surface points in the task frame in [m], shape (N, 3).
        normals: Outward unit normals, shape (N, 3).
        gripper: The hand.
        config: Density and limits; ``max_candidates`` plays no part.
        rng: Source of randomness.
        support_height: Height of the plane that things stand on, in the task frame in
            [m]; None = nothing below matters.
        obstacles: More points that the hand must not touch, not to be grasped, in
            [m], shape (M, 3).

    Returns:
        All distinct grasps that fit, those first whose pads meet the surface best.

    Raises:
        ShapeError: If points and normals are not both (N, 3).
    """
    if points.ndim != 2 or points.shape[1] != 3 or points.shape != normals.shape:
        raise ShapeError("points, normals", "(N, 3) both", points.shape)
    if not len(points):
        return Proposals(np.zeros((0, 4, 4)), np.zeros(0), np.zeros(0))
    cloud = np.concatenate([points, normals], axis=1)[thin(points, config.voxel, rng)]
    seeds = choose_seeds(cloud[:, :3], config.n_seeds, rng)
    hands = _orient(cloud, seeds, gripper, config, rng)
    hands = _above_support(hands, gripper, support_height)
    found = _advance(cloud, seeds, hands, gripper, config, support_height)
    found = _inspect(cloud, found, gripper, config)
    if support_height is not None:
        found = _lift(found, gripper, config, support_height)
    solid = cloud[:, :3]
    if obstacles is not None and len(obstacles):
        solid = np.concatenate([solid, obstacles])
    found = _free(found, solid, gripper, config)
    return found.take(
        distinct(found.poses, found.scores, config.distance, config.angle)
    )


def choose(found: Proposals, n_max: int) -> GraspSet:
    """Take the best proposals, but every region's best before any region's second.

    Args:
        found: Distinct proposals.
        n_max: How many to take at most.
    """
    if not len(found.poses):
        return GraspSet(np.zeros((0, 4, 4)), np.zeros(0))
    best = spread(found.poses[:, :3, 3], found.scores, REGION, n_max)
    return GraspSet(canonical_gripper(found.poses[best]), found.widths[best])


def _orient(
    cloud: FloatArray,
    seeds: IntArray,
    gripper: Gripper,
    config: SamplerConfig,
    rng: np.random.Generator,
) -> _Hands:
    points, normals = cloud[seeds, :3], cloud[seeds, 3:]
    onto = hands_onto(points, normals, config.tilts(), config.n_yaws, rng)
    reach = gripper.max_opening - config.width_margin
    pairs = facing_contacts(cloud, seeds, reach, 2 * config.voxel, MAX_CONTACT_ANGLE)
    around = hands_around(pairs.middles, pairs.axes, config.n_rolls, rng)
    poses = np.concatenate([onto.reshape(-1, 4, 4), around.reshape(-1, 4, 4)])
    seed = np.concatenate(
        [
            np.repeat(np.arange(len(seeds)), onto.shape[1]),
            np.repeat(pairs.seeds, config.n_rolls),
        ]
    )
    centered = np.arange(len(poses)) >= onto.shape[0] * onto.shape[1]
    wanted = np.flatnonzero(poses[:, 2, 2] <= config.max_approach_z)
    order = wanted[np.argsort(seed[wanted], kind="stable")]
    return _Hands(poses[order], seed[order], centered[order])


def _support_limit(
    poses: FloatArray, gripper: Gripper, support_height: float | None, clearance: float
) -> FloatArray:
    """Return the furthest advance along z above the support plane, (G,)."""
    if support_height is None:
        return np.full(len(poses), np.inf)
    openings = np.full(len(poses), gripper.max_opening)
    height = support_clearance(poses, openings, gripper, support_height) - clearance
    descent = -poses[:, 2, 2]
    limit = height / np.maximum(descent, 1e-6)
    return np.where(descent > 1e-6, limit, np.where(height >= 0, np.inf, -np.inf))


def _above_support(
    hands: _Hands, gripper: Gripper, support_height: float | None
) -> _Hands:
    """Drop the hands that cut the support plane before they reach the object."""
    limit = _support_limit(hands.poses, gripper, support_height, 0.0)
    keep = limit > -gripper.finger_depth / 4
    return _Hands(hands.poses[keep], hands.seeds[keep], hands.centered[keep])


def _advance(
    cloud: FloatArray,
    seeds: IntArray,
    hands: _Hands,
    gripper: Gripper,
    config: SamplerConfig,
    support_height: float | None,
) -> Proposals:
    """Centre the hands and advance them to their depths; widths stay open."""
    advance = _half_advance(gripper)
    relief = config.min_insertion / 2  # given up where nothing else is possible
    settings = SweepSettings(
        gripper.max_opening, SEED_RADIUS, 2 * config.min_insertion,
        config.min_insertion, config.inflation, config.palm_gap, 2 * config.voxel,
        advance + relief, config.threads,
    )  # fmt: skip
    found = sweep_depths(
        cloud[:, :3], cloud[seeds, :3], hands.poses,
        np.bincount(hands.seeds, minlength=len(seeds)), hands.centered,
        hand_measures(gripper), settings,
    )  # fmt: skip
    reached = np.flatnonzero(found.deep >= found.shallow - advance - relief)
    poses = hands.poses[reached]
    poses[:, :3, 3] += found.shifts[reached, None] * poses[:, :3, 1]
    touch, shallow = found.deep[reached], found.shallow[reached] - advance
    deep, relaxed = (
        np.minimum(touch, _support_limit(poses, gripper, support_height, c) - advance)
        for c in (config.clearance, config.min_clearance)
    )
    marginal = deep < shallow
    deep = np.where(marginal, relaxed, deep)
    shallow = np.where(marginal, shallow - relief, shallow)
    fits = deep >= shallow
    fractions = np.array(config.depth_fractions)
    depths = shallow[fits, None] + fractions * (deep - shallow)[fits, None]
    poses = np.repeat(poses[fits, None], len(fractions), axis=1)
    poses[..., :3, 3] += depths[..., None] * poses[..., :3, 2]
    scores = (DEPTH_BONUS * fractions - marginal[fits, None]).reshape(-1)
    return Proposals(poses.reshape(-1, 4, 4), scores, np.zeros(len(scores)))


def _half_advance(gripper: Gripper) -> float:
    """Return the tips' advance on something of medium width, in [m]."""
    return float(tip_advance_at(gripper, np.array(gripper.max_opening / 2)))


def _inspect(
    cloud: FloatArray, found: Proposals, gripper: Gripper, config: SamplerConfig
) -> Proposals:
    """Centre the jaws on what they enclose; keep what the pads meet squarely."""
    closing = found.poses.copy()
    closing[:, :3, 3] += _half_advance(gripper) * closing[:, :3, 2]
    opening, hand = gripper.max_opening, hand_measures(gripper)
    content = jaw_content(cloud, closing, opening, hand, threads=config.threads)
    alignment = content.other if config.one_sided else content.alignment
    extents = content.upper - content.lower  # -inf where there is nothing
    fits = extents + 2 * config.inflation <= opening
    keep = (alignment >= config.min_alignment) & np.isfinite(extents) & fits
    poses = found.poses[keep]
    middle = (content.upper[keep] + content.lower[keep]) / 2
    poses[:, :3, 3] += middle[:, None] * poses[:, :3, 1]
    widths = np.minimum(extents[keep] + 2 * config.width_margin, opening)
    return Proposals(poses, found.scores[keep] + alignment[keep], widths)


def _lift(
    found: Proposals, gripper: Gripper, config: SamplerConfig, support_height: float
) -> Proposals:
    """Move hands back that centring, or closing on a linkage, puts into the plane."""
    contact_widths = found.widths - 2 * config.width_margin
    descent = np.maximum(-found.poses[:, 2, 2], 0.0)
    openings = np.full(len(found.poses), gripper.max_opening)
    height = support_clearance(found.poses, openings, gripper, support_height)
    height -= descent * tip_advance_at(gripper, contact_widths) + config.min_clearance
    back = np.maximum(-height, 0.0) / np.maximum(descent, 0.1)
    poses = found.poses.copy()
    poses[:, :3, 3] -= back[:, None] * poses[:, :3, 2]
    return found._replace(poses=poses)


def _free(
    found: Proposals, solid: FloatArray, gripper: Gripper, config: SamplerConfig
) -> Proposals:
    """Keep what reaches its grasp untouched, open or, if allowed, half closed."""
    openings = np.full(len(found.poses), gripper.max_opening)
    limits = config.inflation, config.retreat, config.threads
    free = approach_is_free(found.poses, openings, solid, gripper, *limits)
    if not config.half_closed:
        return found.take(free)
    narrow = ~free
    free[narrow] = approach_is_free(
        found.poses[narrow], found.widths[narrow], solid, gripper, *limits
    )
    scores = found.scores - NARROW_PENALTY * narrow
    return found._replace(scores=scores).take(free)
