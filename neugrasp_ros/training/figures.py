# SPDX-License-Identifier: Apache-2.0
"""Figures of predictions, with intervals over the scenes they come from."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from neugrasp_ros.training.metrics import (
    average_precision,
    expected_calibration_error,
    roc_auc,
)
from neugrasp_ros.training.quality import Predictions, merged

N_DRAWS = 300
MACRO = "macro"


def quality_figures(scores: Predictions) -> dict[str, float]:
    """Return how well the quality tells successes from failures."""
    quality, labels = scores.quality[scores.judged], scores.labels[scores.judged]
    return {
        "grasps": len(labels),
        "positive": float(np.mean(labels)) if len(labels) else float("nan"),
        "auc": roc_auc(quality, labels),
        "ap": average_precision(quality, labels),
        "ece": expected_calibration_error(quality, labels),
    }


def affordance_figures(
    scores: Predictions, classes: Iterable[str]
) -> dict[str, dict[str, float]]:
    """Return how well each class is told, over the grasps that hold.

    Returns:
        By class: grasps, positives, prevalence, ap, auc, ece.
    """
    figures = {}
    for column, name in enumerate(classes):
        predicted = scores.affordances[scores.known, column]
        afforded = scores.afforded[scores.known, column]
        figures[name] = {
            "grasps": len(afforded),
            "positives": int(afforded.sum()),
            "prevalence": float(afforded.mean()) if len(afforded) else float("nan"),
            "ap": average_precision(predicted, afforded),
            "auc": roc_auc(predicted, afforded),
            "ece": expected_calibration_error(predicted, afforded),
        }
    return figures


def average_precisions(scores: Predictions, classes: Iterable[str]) -> dict[str, float]:
    """Return the average precision of each class, and ``macro``, their mean.

    The mean is over the classes that occur.
    """
    known = scores.known
    found = {
        name: average_precision(
            scores.affordances[known, column], scores.afforded[known, column]
        )
        for column, name in enumerate(classes)
    }
    finite = [ap for ap in found.values() if np.isfinite(ap)]
    return {**found, MACRO: float(np.mean(finite)) if finite else float("nan")}


def intervals(
    parts: Sequence[Predictions],
    figures: Callable[[Predictions], dict[str, float]],
    rng: np.random.Generator,
    n_draws: int = N_DRAWS,
) -> dict[str, list[float] | None]:
    """Return the 95 % bootstrap intervals of figures over scenes.

    Grasps of one scene depend on each other, so whole scenes are drawn.

    Args:
        parts: Predictions of each scene.
        figures: Computes the figures; one that is not finite in a draw is left out
            there.
        rng: Source of randomness.
        n_draws: Bootstrap samples.

    Returns:
        Lower and upper bound by figure; None if it was never finite.
    """
    draws = [
        figures(merged(parts[row] for row in rows))
        for rows in rng.integers(len(parts), size=(n_draws, len(parts)))
    ]
    bounds: dict[str, list[float] | None] = {}
    for name in draws[0]:
        values = np.array([draw[name] for draw in draws])
        values = values[np.isfinite(values)]
        bounds[name] = (
            np.quantile(values, [0.025, 0.975]).tolist() if len(values) else None
        )
    return bounds
