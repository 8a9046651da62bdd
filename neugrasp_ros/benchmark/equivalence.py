# SPDX-License-Identifier: Apache-2.0
"""Is anything lost by being fast: the same rays and the same grasps, both ways."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.shots import Shot
from neugrasp_ros.config import ReferenceConfig
from neugrasp_ros.geometry.ray_search import first_crossings
from neugrasp_ros.pipeline import EncodedScene, GraspPlanner
from neugrasp_ros.scene.reference import reference_rays, reference_samples

FloatArray = NDArray[np.float64]

NEAR = 0.0015  # [m]; surfaces nearer than this are the same
SCORE_GAP = 0.03  # a best grasp that the reference scores this near its own is as good


class RayCheck(NamedTuple):
    """Rays of the reference cameras, both ways.

    Attributes:
        same_hit: Share of the rays that both meet something on, or neither.
        near: Share of the rays that both meet something on, within 1.5 mm.
        met: Share of the rays that meet something in the reference.
        median: Median distance of the two surfaces along the ray in [m].
    """

    same_hit: float
    near: float
    met: float
    median: float


def compare_rays(
    planner: GraspPlanner,
    scene: EncodedScene,
    n_rays: int,
    rng: np.random.Generator,
    config: ReferenceConfig | None = None,
) -> RayCheck:
    """Cast random rays of the reference cameras both ways.

    Args:
        planner: The fast planner.
        scene: A scene of one cube.
        n_rays: Rays.
        rng: Chooses the rays.
        config: The reference cameras; default the paper's.
    """
    config = config or ReferenceConfig()
    origins, directions = reference_rays(config, scene.edge)
    chosen = rng.permutation(len(origins))[:n_rays]
    origins, directions = origins[chosen], directions[chosen]
    fast = planner.trace(scene, origins, directions)
    slow = first_crossings(
        planner.reference(scene), origins, directions, reference_samples(config)
    )
    there = origins + slow[:, None] * directions
    slow[~((there >= 0) & (there <= scene.edge)).all(axis=1)] = np.nan
    hits = np.isfinite(slow)
    both = hits & np.isfinite(fast)
    gaps = np.abs(fast - slow)[both]
    return RayCheck(
        float((hits == np.isfinite(fast)).mean()),
        float((gaps <= NEAR).mean()) if len(gaps) else 1.0,
        float(hits.mean()),
        float(np.median(gaps)) if len(gaps) else 0.0,
    )


class ScoreCheck(NamedTuple):
    """Scores of the same grasps, both ways.

    Attributes:
        gaps: Absolute differences, as many as grasps were compared.
        best_gap: What the reference scores the fast path's best below its own; 0 if
            there are no grasps.
    """

    gaps: list[float]
    best_gap: float


def compare_scores(
    fast: GraspPlanner,
    slow: GraspPlanner,
    shot: Shot,
    n_grasps: int,
    rng: np.random.Generator,
) -> ScoreCheck:
    """Score the same candidates of a scene both ways."""
    volume = shot.fused(fast.resolution)
    scene = fast.encode(volume, 1)
    grasps = fast.sample(scene)
    if not len(grasps):
        return ScoreCheck([], 0.0)
    grasps = grasps.take(rng.permutation(len(grasps))[:n_grasps])
    quick = fast.evaluate(scene, grasps).quality
    truth = slow.evaluate(slow.encode(volume, 1), grasps).quality
    gaps = np.abs(quick - truth).tolist()
    return ScoreCheck(gaps, float(truth.max() - truth[quick.argmax()]))


def check_rays(
    fast: GraspPlanner, shots: Sequence[Shot], *, n_rays: int = 4096, seed: int = 0
) -> dict[str, float]:
    """Compare rays over scenes.

    The reference takes the paper's rays and samples, and asks the network at each
    through the compiled decoder: the same numbers, in minutes instead of hours.

    Args:
        fast: The fast planner.
        shots: Scenes of one cube.
        n_rays: Rays of a scene.
        seed: Of the choice of rays.

    Returns:
        Shares over all rays of all scenes; those of surfaces that are near to each
        other count the rays that both meet something on.
    """
    rng = np.random.default_rng(seed)
    rays = []
    for number, shot in enumerate(shots):
        scene = fast.encode(shot.fused(fast.resolution), 10**6 + number)
        rays.append(compare_rays(fast, scene, n_rays, rng))
    met = np.array([check.met for check in rays])
    return {
        "rays_scenes": len(rays),
        "rays_per_scene": n_rays,
        "rays_same_hit": float(np.mean([check.same_hit for check in rays])),
        "rays_same_hit_worst_scene": min(check.same_hit for check in rays),
        "rays_met": float(met.mean()),
        "rays_within_1_5_mm": float(
            np.average([check.near for check in rays], weights=met + 1e-9)
        ),
        "rays_median_mm": 1e3 * float(np.median([check.median for check in rays])),
    }


def check_scores(
    fast: GraspPlanner,
    shots: Sequence[Shot],
    *,
    n_grasps: int = 32,
    seed: int = 0,
    known: Mapping[int, ScoreCheck] | None = None,
    keep: Callable[[int, ScoreCheck], None] = lambda *_: None,
) -> dict[str, float]:
    """Compare scores over scenes, with a reference as of ``check_rays``.

    Args:
        fast: The fast planner.
        shots: Scenes of one cube.
        n_grasps: Grasps of a scene.
        seed: Of the choice of grasps; each scene has a generator of its own.
        known: Scenes that were compared before, by their number.
        keep: Told every other scene's number and what came of it.

    Returns:
        As ``score_figures``.
    """
    config = replace(fast.config, renderer="compiled_reference")
    slow = GraspPlanner(config, fast.gripper)
    checks = dict(known or {})
    for number, shot in enumerate(shots):
        if number not in checks:
            rng = np.random.default_rng([seed, number])
            checks[number] = compare_scores(fast, slow, shot, n_grasps, rng)
            keep(number, checks[number])
    return score_figures([checks[number] for number in range(len(shots))])


def score_figures(checks: Sequence[ScoreCheck]) -> dict[str, float]:
    """Pool scenes.

    Returns:
        Mean and 95th percentile of the differences, the share of the scenes in which
        the fast path's best is as good in the reference's eyes, and how much worse it
        is in the worst scene; empty if no scene has a candidate.
    """
    checks = [check for check in checks if check.gaps]
    if not checks:
        return {}
    gaps = np.concatenate([check.gaps for check in checks])
    best = np.array([check.best_gap for check in checks])
    return {
        "scores_scenes": len(checks),
        "scores_grasps": len(gaps),
        "scores_mean_gap": float(gaps.mean()),
        "scores_p95_gap": float(np.percentile(gaps, 95)),
        "scores_best_as_good": float((best <= SCORE_GAP).mean()),
        "scores_best_worst_gap": float(best.max()),
    }
