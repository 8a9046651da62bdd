# SPDX-License-Identifier: Apache-2.0
"""Metrics of probabilities against values worked out by hand."""

import numpy as np
import pytest

from neugrasp_ros.training.metrics import (
    average_precision,
    expected_calibration_error,
    platt_scaling,
    roc_auc,
)


def test_average_precision_of_a_known_ranking() -> None:
    probabilities = np.array([0.9, 0.8, 0.7, 0.6])
    labels = np.array([1.0, 0.0, 1.0, 0.0])
    assert average_precision(probabilities, labels) == pytest.approx((1 + 2 / 3) / 2)


def test_auc_counts_ties_half() -> None:
    labels = np.array([1, 0, 1, 0])
    assert roc_auc(np.array([0.9, 0.1, 0.8, 0.2]), labels) == 1.0
    assert roc_auc(np.full(4, 0.5), labels) == 0.5
    assert roc_auc(np.array([0.1, 0.9, 0.2, 0.8]), labels) == 0.0


def test_one_class_alone_has_no_auc() -> None:
    assert np.isnan(roc_auc(np.array([0.1, 0.2]), np.ones(2)))
    assert np.isnan(average_precision(np.array([0.1, 0.2]), np.zeros(2)))


def test_calibration_error_is_the_gap() -> None:
    labels = np.array([1.0, 1, 0, 0])
    assert expected_calibration_error(np.full(4, 0.5), labels) == pytest.approx(0.0)
    assert expected_calibration_error(np.full(4, 0.9), labels) == pytest.approx(0.4)


def test_platt_scaling_repairs_overconfidence() -> None:
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 1.5, 20000)
    labels = (rng.random(20000) < 1 / (1 + np.exp(-logits))).astype(float)
    overconfident = 1 / (1 + np.exp(-(3 * logits + 1)))
    scale, bias = platt_scaling(overconfident, labels)
    assert scale == pytest.approx(1 / 3, abs=0.03)
    assert bias == pytest.approx(-1 / 3, abs=0.08)
