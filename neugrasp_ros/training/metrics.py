# SPDX-License-Identifier: Apache-2.0
"""How good predicted probabilities are, and how to make them honest."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logit

FloatArray = NDArray[np.floating]

CALIBRATION_BINS = 15
EDGE_PROBABILITY = 1e-6


def average_precision(probabilities: FloatArray, labels: FloatArray) -> float:
    """Return the area under the precision-recall steps; NaN without positives."""
    order = np.argsort(-probabilities, kind="stable")
    hits = np.asarray(labels)[order] > 0.5
    if not hits.any():
        return float("nan")
    precision = np.cumsum(hits) / np.arange(1, len(hits) + 1)
    return float(precision[hits].mean())


def roc_auc(probabilities: FloatArray, labels: FloatArray) -> float:
    """Return the chance that a positive outranks a negative (ties count half)."""
    positive = np.asarray(labels) > 0.5
    n, m = int(positive.sum()), int((~positive).sum())
    if not n or not m:
        return float("nan")
    values, inverse, counts = np.unique(
        probabilities, return_inverse=True, return_counts=True
    )
    ranks = (np.cumsum(counts) - (counts - 1) / 2)[inverse]
    return float((ranks[positive].sum() - n * (n + 1) / 2) / (n * m))


def expected_calibration_error(probabilities: FloatArray, labels: FloatArray) -> float:
    """Return the mean gap between predicted and true rate over 15 equal bins.

    That of nothing is NaN.
    """
    if not len(labels):
        return float("nan")
    bins = np.minimum(
        (np.asarray(probabilities) * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1
    )
    error = 0.0
    for index in np.unique(bins):
        inside = bins == index
        gap = abs(np.mean(probabilities[inside]) - np.mean(labels[inside]))
        error += gap * inside.mean()
    return float(error)


def platt_scaling(probabilities: FloatArray, labels: FloatArray) -> tuple[float, float]:
    """Fit ``sigmoid(scale * logit + bias)`` to labels by maximum likelihood.

    Args:
        probabilities: Uncalibrated predictions, shape (N,).
        labels: 0 or 1, shape (N,).

    Returns:
        Scale and bias.
    """
    clipped = np.clip(probabilities, EDGE_PROBABILITY, 1 - EDGE_PROBABILITY)
    logits = logit(clipped.astype(np.float64))
    target = np.asarray(labels, dtype=np.float64)

    def loss(x: FloatArray) -> float:
        p = np.clip(expit(x[0] * logits + x[1]), 1e-9, 1 - 1e-9)
        return float(-np.mean(target * np.log(p) + (1 - target) * np.log(1 - p)))

    scale, bias = minimize(loss, np.array([1.0, 0.0]), method="Nelder-Mead").x
    return float(scale), float(bias)
