# SPDX-License-Identifier: Apache-2.0
import dataclasses
from collections import Counter

import numpy as np
import pytest
from label_work import labels_of

from neugrasp_ros.datagen.agreement import (
    Outcomes,
    Recheck,
    count_agreement,
    draw_rechecks,
    group_of,
    possible_openings,
    recheck,
)
from neugrasp_ros.datagen.candidates import CandidateConfig
from neugrasp_ros.datagen.labels import SceneJob, label_scene


def test_each_group_gives_at_most_so_many_and_only_tried_grasps():
    scenes = [
        labels_of(index, n_grasps=20, kind=kind)
        for index, kind in enumerate(["pile", "packed", "pile"])
    ]
    jobs = draw_rechecks(scenes, 15, np.random.default_rng(0))
    counts = Counter()
    for job in jobs:
        assert job.labels.grasps.tried[job.rows].all()
        assert len(set(job.rows.tolist())) == len(job.rows)
        counts[group_of(job.labels)] += len(job.rows)
    tried = sum(int(labels.grasps.tried.sum()) for labels in (scenes[0], scenes[2]))
    assert counts["pile/panda"] == min(15, tried)
    assert counts["packed/panda"] == min(15, int(scenes[1].grasps.tried.sum()))


def test_differences_are_counted_by_their_kind():
    yes, no = np.array([True, True, False]), np.array([True, False, True])
    counts = count_agreement([Outcomes("a", yes, no), Outcomes("b", yes, yes)])
    assert counts["a"] == {
        "n": 3, "agree": 1, "false_positive": 1, "false_negative": 1,
    }  # fmt: skip
    assert counts["all"]["agree"] == 4


@pytest.mark.slow
def test_labels_are_mostly_the_full_executions():
    job = SceneJob(
        index=0, seed=3, kind="packed", objects="procedural", split="train",
        gripper="panda", candidates=CandidateConfig(n_trials=10, n_collisions=0),
    )  # fmt: skip
    labels = label_scene(job)
    rows = np.flatnonzero(labels.grasps.tried)
    outcomes = recheck(Recheck(labels, rows))
    agree = outcomes.labelled == outcomes.full
    assert agree.mean() >= 0.8
    upside_down = dataclasses.replace(
        labels.grasps, positions=labels.grasps.positions + np.float32([0, 0, 0.2])
    )
    high = recheck(Recheck(dataclasses.replace(labels, grasps=upside_down), rows))
    assert not high.full.any()


def test_fully_open_jaws_stay_possible_in_single_precision():
    limit = 0.08690370377134729
    stored = np.array([limit, 0.04], dtype=np.float32)
    assert float(stored[0]) > limit
    openings = possible_openings(stored, limit)
    assert openings[0] == limit and abs(openings[1] - 0.04) < 1e-8
