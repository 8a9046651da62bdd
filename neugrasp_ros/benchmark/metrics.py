# SPDX-License-Identifier: Apache-2.0
"""Grasp success rate and declutter rate with their intervals.

GSR = successes / attempts, DR = successes / objects, pooled over all rounds.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.benchmark.records import RoundRecord
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.training.metrics import (
    average_precision,
    expected_calibration_error,
)

Z_95 = 1.959964  # two-sided 95 % quantile of the normal distribution
N_BOOTSTRAP = 2000
HARDEST = 5  # objects that are named


class Interval(NamedTuple):
    """A 95 % interval."""

    lower: float
    upper: float


def wilson_interval(successes: int, trials: int, z: float = Z_95) -> Interval:
    """Return Wilson's interval of a proportion; (0, 1) without trials.

    Args:
        successes: Number of successes.
        trials: Number of independent trials.
        z: Normal quantile.

    Raises:
        ConfigError: If there are more successes than trials, or negative ones.
    """
    if not 0 <= successes <= trials:
        raise ConfigError(f"{successes} successes of {trials} trials cannot be")
    if trials == 0:
        return Interval(0.0, 1.0)
    share = successes / trials
    center = share + z * z / (2 * trials)
    spread = z * np.sqrt(share * (1 - share) / trials + z * z / (4 * trials**2))
    scale = 1 + z * z / trials
    return Interval(
        float(max(center - spread, 0.0) / scale),
        float(min((center + spread) / scale, 1.0)),
    )


def bootstrap_ratio(
    numerators: NDArray[np.float64],
    denominators: NDArray[np.float64],
    rng: np.random.Generator,
    n_draws: int = N_BOOTSTRAP,
) -> Interval:
    """Return the bootstrap interval of a pooled ratio over rounds.

    Attempts of one round depend on each other, so whole rounds are drawn.

    Args:
        numerators: Per round, shape (N,).
        denominators: Per round, shape (N,).
        rng: Source of randomness.
        n_draws: Bootstrap samples.
    """
    if not denominators.sum() > 0:
        return Interval(0.0, 1.0)
    rows = rng.integers(len(numerators), size=(n_draws, len(numerators)))
    tops, bottoms = numerators[rows].sum(axis=1), denominators[rows].sum(axis=1)
    ratios = tops[bottoms > 0] / bottoms[bottoms > 0]
    lower, upper = np.quantile(ratios, [0.025, 0.975])
    return Interval(float(lower), float(upper))


def summarize(
    rounds: Sequence[RoundRecord], rng: np.random.Generator
) -> dict[str, Any]:
    """Return the benchmark's figures, rates in percent.

    Args:
        rounds: The rounds of one suite.
        rng: Source of the bootstrap's randomness.

    Returns:
        ``gsr``, ``gsr_ci`` (Wilson over attempts), ``gsr_ci_rounds`` (bootstrap over
        rounds), ``dr``, ``dr_ci`` (bootstrap over rounds), counts, the failures by
        name, the objects that failed most (``hardest``), how rounds ended, ``iou`` and
        ``iou_ci`` (mean over the rounds' first views, bootstrap), ``quality_ap`` and
        ``quality_ece`` of the executed grasps' promised quality, and milliseconds per
        stage (median and 90th percentile).
        A rate without a denominator is None.
    """
    successes = np.array([r.n_successes for r in rounds], dtype=np.float64)
    attempts = np.array([len(r.attempts) for r in rounds], dtype=np.float64)
    objects = np.array([r.n_counted for r in rounds], dtype=np.float64)
    n_successes, n_attempts = int(successes.sum()), int(attempts.sum())
    return {
        "gsr": _percent(n_successes, n_attempts),
        "gsr_ci": _percents(wilson_interval(n_successes, n_attempts)),
        "gsr_ci_rounds": _percents(bootstrap_ratio(successes, attempts, rng)),
        "dr": _percent(n_successes, int(objects.sum())),
        "dr_ci": _percents(bootstrap_ratio(successes, objects, rng)),
        "attempts": n_attempts,
        "successes": n_successes,
        "objects": int(objects.sum()),
        "rounds": len(rounds),
        "failures": dict(
            Counter(a.reason for r in rounds for a in r.attempts if a.reason)
        ),
        "hardest": _hardest(rounds),
        "ended": dict(Counter(r.ended for r in rounds)),
        **_reconstruction(rounds, rng),
        **_promises(rounds),
        "milliseconds": stage_times(rounds),
    }


def _hardest(rounds: Sequence[RoundRecord]) -> dict[str, dict[str, int]]:
    """Return attempts and failures of the objects that failed most often."""
    tried = [attempt for r in rounds for attempt in r.attempts if attempt.target]
    attempts = Counter(attempt.target for attempt in tried)
    failures = Counter(attempt.target for attempt in tried if not attempt.success)
    return {
        name: {"attempts": attempts[name], "failures": count}
        for name, count in failures.most_common(HARDEST)
    }


def _reconstruction(
    rounds: Sequence[RoundRecord], rng: np.random.Generator
) -> dict[str, Any]:
    ious = np.array([r.iou for r in rounds if r.iou is not None])
    if not len(ious):
        return {"iou": None, "iou_ci": None}
    bounds = bootstrap_ratio(ious, np.ones(len(ious)), rng)
    return {"iou": 100.0 * float(ious.mean()), "iou_ci": _percents(bounds)}


def _promises(rounds: Sequence[RoundRecord]) -> dict[str, float | None]:
    """Return how well the promised quality tells which executed grasps succeed."""
    attempts = [a for r in rounds for a in r.attempts if np.isfinite(a.quality)]
    promised = np.array([a.quality for a in attempts])
    success = np.array([a.success for a in attempts], dtype=np.float64)
    figures: dict[str, float | None] = {"quality_ap": None, "quality_ece": None}
    if success.any():
        figures["quality_ap"] = 100.0 * average_precision(promised, success)
    if len(attempts):
        ece = expected_calibration_error(promised, success)
        figures["quality_ece"] = 100.0 * ece
    return figures


def stage_times(rounds: Sequence[RoundRecord]) -> dict[str, dict[str, float]]:
    """Return median and 90th percentile of each stage's time in [ms]."""
    stages: dict[str, list[float]] = {}
    for record in rounds:
        for attempt in record.attempts:
            for stage, seconds in attempt.timings.items():
                stages.setdefault(stage, []).append(1e3 * seconds)
    return {
        stage: {
            "median": float(np.median(values)),
            "p90": float(np.quantile(values, 0.9)),
        }
        for stage, values in stages.items()
    }


def _percent(count: int, total: int) -> float | None:
    return 100.0 * count / total if total else None


def _percents(interval: Interval) -> list[float]:
    return [100.0 * interval.lower, 100.0 * interval.upper]
