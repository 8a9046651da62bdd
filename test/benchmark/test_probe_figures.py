# SPDX-License-Identifier: Apache-2.0
import json

import numpy as np
import pytest

from neugrasp_ros.benchmark.probe_figures import summarize_probes
from neugrasp_ros.benchmark.probes import Answer, ProbeRecord

CLASSES = ("cut", "pour")


def probe_of(index, answers, predicted=(), afforded=()):
    return ProbeRecord(
        index=index, n_tried=5, predicted=predicted, afforded=afforded,
        answers=answers, scene={},
    )  # fmt: skip


def answer_of(exists, answered=False, success=False, affords=False, name="pour"):
    return Answer(
        affordance=name, exists=exists, answered=answered, success=success,
        affords=affords,
    )  # fmt: skip


def test_rates_have_their_own_denominators():
    answers = (
        answer_of(True, True, True, True),
        answer_of(True, True, True, False),
        answer_of(True, False),
        answer_of(True, True, False, True, name="cut"),
        answer_of(None, True, True, True),  # cannot be told: counts nowhere
        answer_of(False, True),
        answer_of(False, False),
    )
    figures = summarize_probes(
        [probe_of(0, answers)], CLASSES, np.random.default_rng(0)
    )
    assert figures["first_answer"]["rate"] == 25.0
    assert figures["first_answer"]["queries"] == 4
    assert figures["first_answer_holds"]["rate"] == 50.0
    assert figures["first_answer_given"]["rate"] == 75.0
    assert figures["first_answer_by_class"]["cut"]["rate"] == 0.0
    assert figures["first_answer_by_class"]["pour"]["rate"] == pytest.approx(100 / 3)
    assert figures["wrongly_answered"] == {
        "rate": 50.0, "ci": pytest.approx([9.45, 90.55], abs=0.01), "queries": 2,
    }  # fmt: skip
    assert figures["ap_macro"] is None


def test_precision_is_over_the_grasps_of_all_scenes_that_hold():
    probes = [
        probe_of(0, (), ((0.1, 0.9), (0.2, 0.3)), ((False, True), (False, False))),
        probe_of(1, ()),
        probe_of(2, (), ((0.3, 0.8), (0.1, 0.7)), ((False, False), (False, True))),
    ]
    figures = summarize_probes(probes, CLASSES, np.random.default_rng(0))
    assert (figures["scenes"], figures["grasps"]) == (3, 4)
    assert figures["ap"]["pour"] == pytest.approx(100 * (1 + 2 / 3) / 2)
    assert figures["ap"]["cut"] is None
    assert figures["prevalence"] == {"cut": 0.0, "pour": 50.0}
    assert figures["positives"] == {"cut": 0, "pour": 2}
    assert figures["ap_macro"] == pytest.approx(figures["ap"]["pour"])
    json.dumps(figures, allow_nan=False)
    low, high = figures["ap_macro_ci"]
    assert low <= figures["ap_macro"] <= high
