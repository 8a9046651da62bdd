# SPDX-License-Identifier: Apache-2.0
import json
from dataclasses import replace

import numpy as np
import pytest

from neugrasp_ros.benchmark.metrics import (
    bootstrap_ratio,
    summarize,
    wilson_interval,
)
from neugrasp_ros.benchmark.records import (
    AttemptRecord,
    RoundRecord,
    round_from_record,
)
from neugrasp_ros.errors import ConfigError


def attempt(number, reason, seconds=0.1):
    return AttemptRecord(
        round_index=0,
        number=number,
        reason=reason,
        quality=0.9,
        T_task_gripper=(1.0,) * 12,
        opening=0.08,
        width=0.04,
        stop_depth=0.0,
        object_name="" if reason else "mug",
        n_candidates=50,
        n_grasps=10,
        timings={"plan": seconds},
        target="vase" if reason else "mug",
    )


def round_of(reasons, n_objects=5, n_uncounted=0):
    return RoundRecord(
        index=0,
        n_objects=n_objects,
        n_uncounted=n_uncounted,
        ended="failures",
        attempts=tuple(attempt(i, reason) for i, reason in enumerate(reasons)),
        scene={"kind": "pile", "seed": 0, "objects": []},
    )


def test_wilson_matches_published_values():
    lower, upper = wilson_interval(8, 10)
    assert abs(lower - 0.4902) < 1e-4 and abs(upper - 0.9433) < 1e-4
    assert wilson_interval(0, 0) == (0.0, 1.0)
    assert wilson_interval(0, 20).lower == 0.0
    assert wilson_interval(20, 20).upper == pytest.approx(1.0)
    with pytest.raises(ConfigError, match="cannot be"):
        wilson_interval(3, 2)


def test_the_bootstrap_brackets_the_pooled_ratio_and_repeats_with_its_seed():
    rng = np.random.default_rng(0)
    tops = rng.binomial(5, 0.8, 100).astype(float)
    bottoms = np.full(100, 5.0)
    interval = bootstrap_ratio(tops, bottoms, np.random.default_rng(1))
    share = tops.sum() / bottoms.sum()
    assert interval.lower < share < interval.upper
    assert 0.04 < interval.upper - interval.lower < 0.11
    assert interval == bootstrap_ratio(tops, bottoms, np.random.default_rng(1))


def test_rates_are_pooled_over_rounds_and_named():
    rounds = [round_of(["", "", "empty"]), round_of(["slipped", ""], 4, n_uncounted=1)]
    figures = summarize(rounds, np.random.default_rng(0))
    assert figures["gsr"] == pytest.approx(60.0)
    assert figures["dr"] == pytest.approx(100 * 3 / 8)
    assert figures["failures"] == {"empty": 1, "slipped": 1}
    assert figures["hardest"] == {"vase": {"attempts": 2, "failures": 2}}
    assert (figures["attempts"], figures["objects"], figures["rounds"]) == (5, 8, 2)
    assert figures["milliseconds"]["plan"]["median"] == pytest.approx(100.0)
    json.dumps(figures)


def test_reconstructions_are_averaged_and_promises_are_checked():
    rounds = [
        replace(round_of(["", "empty"]), iou=0.6),
        replace(round_of([""]), iou=0.8),
        round_of([""]),
    ]
    figures = summarize(rounds, np.random.default_rng(0))
    assert figures["iou"] == pytest.approx(70.0)
    assert 60.0 <= figures["iou_ci"][0] < figures["iou_ci"][1] <= 80.0
    assert figures["quality_ap"] == pytest.approx(100 * (1 + 2 / 3 + 3 / 4) / 3)
    assert figures["quality_ece"] == pytest.approx(15.0)  # promised 90, kept 75
    nothing = summarize([round_of(["empty"])], np.random.default_rng(0))
    assert nothing["iou"] is None and nothing["quality_ap"] is None
    assert nothing["quality_ece"] == pytest.approx(90.0)


def test_rounds_without_attempts_have_no_rate():
    figures = summarize([round_of([])], np.random.default_rng(0))
    assert figures["gsr"] is None
    assert figures["gsr_ci"] == [0.0, 100.0]
    assert figures["dr"] == 0.0


def test_records_survive_json():
    record = round_of(["", "snagged"])
    again = round_from_record(json.loads(json.dumps(record.as_record())))
    assert again == record
    with pytest.raises(ConfigError, match="round record"):
        round_from_record({"index": 0})
