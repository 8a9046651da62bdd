# SPDX-License-Identifier: Apache-2.0
"""Figures of probes: how well affordances are told, and how good first answers are."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from neugrasp_ros.benchmark.metrics import wilson_interval
from neugrasp_ros.benchmark.probes import ProbeRecord
from neugrasp_ros.training.figures import (
    MACRO,
    affordance_figures,
    average_precisions,
    intervals,
)
from neugrasp_ros.training.quality import Predictions, merged


def summarize_probes(
    probes: Sequence[ProbeRecord], classes: Sequence[str], rng: np.random.Generator
) -> dict[str, Any]:
    """Return the affordance figures of a benchmark, in percent.

    Args:
        probes: Scenes.
        classes: Names of the classes.
        rng: Source of the bootstrap's randomness.

    Returns:
        ``ap``, ``ap_ci``, ``prevalence`` and ``positives`` by class, ``ap_macro`` and
        its interval over scenes; the share of queries with a true grasp whose first
        answer holds and affords it (``first_answer``), and the share of queries
        without one that were answered all the same (``wrongly_answered``).
    """
    answers = [answer for probe in probes for answer in probe.answers]
    real = [a for a in answers if a.exists]
    absent = [a for a in answers if a.exists is False]
    return {
        "scenes": len(probes),
        **_precisions(probes, classes, rng),
        "first_answer": _share([a.success and a.affords for a in real]),
        "first_answer_holds": _share([a.success for a in real]),
        "first_answer_given": _share([a.answered for a in real]),
        "first_answer_by_class": {
            name: _share(
                [a.success and a.affords for a in real if a.affordance == name]
            )
            for name in classes
        },
        "wrongly_answered": _share([a.answered for a in absent]),
    }


def _precisions(
    probes: Sequence[ProbeRecord], classes: Sequence[str], rng: np.random.Generator
) -> dict[str, Any]:
    parts = [_predictions(probe) for probe in probes if probe.predicted]
    if not parts:
        return {"grasps": 0, "ap_macro": None}
    figures = affordance_figures(merged(parts), classes)
    bounds = intervals(parts, lambda drawn: average_precisions(drawn, classes), rng)
    macro = average_precisions(merged(parts), classes)[MACRO]
    return {
        "grasps": sum(len(part.labels) for part in parts),
        "ap": {name: _percent(figures[name]["ap"]) for name in classes},
        "ap_ci": {name: _percents(bounds[name]) for name in classes},
        "prevalence": {name: _percent(figures[name]["prevalence"]) for name in classes},
        "positives": {name: figures[name]["positives"] for name in classes},
        "ap_macro": _percent(macro),
        "ap_macro_ci": _percents(bounds[MACRO]),
    }


def _predictions(probe: ProbeRecord) -> Predictions:
    predicted = np.array(probe.predicted, dtype=np.float32)
    held = np.ones(len(predicted), dtype=np.float32)
    afforded = np.array(probe.afforded, dtype=np.float32)
    return Predictions(held, held, held > 0, predicted, afforded, held > 0)


def _share(outcomes: Sequence[bool]) -> dict[str, Any]:
    """Return a rate in percent, its Wilson interval and its denominator."""
    n = len(outcomes)
    interval = wilson_interval(sum(outcomes), n)
    return {
        "rate": 100.0 * sum(outcomes) / n if n else None,
        "ci": [100.0 * bound for bound in interval],
        "queries": n,
    }


def _percent(share: float) -> float | None:
    return 100.0 * share if np.isfinite(share) else None


def _percents(bounds: list[float] | None) -> list[float] | None:
    return bounds and [100.0 * bound for bound in bounds]
