# SPDX-License-Identifier: Apache-2.0
import errno
import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from label_work import label_or_fail, labels_of

from neugrasp_ros.datagen import factory, shards
from neugrasp_ros.datagen.factory import run_factory
from neugrasp_ros.datagen.jobs import RunPlan
from neugrasp_ros.datagen.shards import done_indices, load_shards, shard_paths
from neugrasp_ros.errors import ConfigError, ShardError
from sim_bridge.trial import TRIAL_PRESETS


def plan(n_scenes=5, seed=0):
    return RunPlan(
        objects=("procedural",), kind="pile", gripper="panda", n_scenes=n_scenes,
        seed=seed,
    )  # fmt: skip


def test_a_run_labels_what_it_can_and_names_what_it_lost(tmp_path):
    lines = []
    progress = run_factory(
        plan(), tmp_path, n_workers=0, work=label_or_fail,
        report=lambda p: lines.append(p.line()),
    )  # fmt: skip
    assert done_indices(tmp_path) == {0, 2, 3, 4}
    assert (progress.n_done, progress.n_labels) == (4, 16)
    assert len(progress.skipped) == 1
    assert "scene 1 " in (tmp_path / "skipped.log").read_text()
    assert "broken mesh" in progress.skipped[0]
    assert len(lines) == 5
    assert "4/5 scenes, 16 labels" in lines[-1]
    assert "ETA" in lines[-1]
    expected = sum(int(labels_of(i).grasps.labels.sum()) for i in (0, 2, 3, 4))
    assert progress.n_positive == progress.reasons["success"] == expected


def test_a_second_start_does_only_what_is_missing(tmp_path):
    seen = []

    def work(job):
        seen.append(job.index)
        return labels_of(job.index)

    run_factory(plan(3), tmp_path, n_workers=0, work=work)
    run_factory(plan(5), tmp_path, n_workers=0, work=work)
    assert seen == [0, 1, 2, 3, 4]
    assert len(shard_paths(tmp_path)) == 2


def test_an_interrupted_run_keeps_what_was_labelled(tmp_path):
    def work(job):
        if job.index == 3:
            raise KeyboardInterrupt
        return labels_of(job.index)

    with pytest.raises(KeyboardInterrupt):
        run_factory(plan(), tmp_path, n_workers=0, work=work)
    assert done_indices(tmp_path) == {0, 1, 2}


def test_shards_are_written_on_the_way(tmp_path, monkeypatch):
    monkeypatch.setattr(factory, "SHARD_SCENES", 2)
    run_factory(plan(), tmp_path, n_workers=0, work=label_or_fail)
    assert [len(shards.read_shard(p)) for p in shard_paths(tmp_path)] == [2, 2]


def test_a_full_disk_stops_with_what_to_do(tmp_path, monkeypatch):
    run_factory(plan(2), tmp_path, n_workers=0, work=label_or_fail)

    def fail(file, **columns):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(ShardError, match="disk is full.*start again"):
        run_factory(plan(), tmp_path, n_workers=0, work=label_or_fail)
    assert [labels.index for labels in load_shards(tmp_path)] == [0]


@pytest.mark.slow
def test_a_killed_run_has_written_every_scene_that_it_reported(tmp_path):
    script = (
        "import os, sys; from label_work import label_or_fail;"
        "from neugrasp_ros.datagen.factory import run_factory;"
        "from neugrasp_ros.datagen.jobs import RunPlan;"
        "plan = RunPlan(objects=('procedural',), kind='pile', gripper='panda',"
        " n_scenes=9, seed=0);"
        "die = lambda p: os.kill(os.getpid(), 9) if p.n_done == 4 else None;"
        "run_factory(plan, sys.argv[1], n_workers=0, work=label_or_fail, report=die)"
    )
    code = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        check=False,
    ).returncode
    assert code == -signal.SIGKILL
    assert done_indices(tmp_path) == {0, 2, 3, 4}


def test_a_folder_holds_one_plan(tmp_path):
    run_factory(plan(1), tmp_path, n_workers=0, work=label_or_fail)
    with pytest.raises(ConfigError, match="begun with another plan.*seed"):
        run_factory(plan(1, seed=9), tmp_path, n_workers=0, work=label_or_fail)


def test_an_older_plan_without_a_field_had_its_default(tmp_path):
    run_factory(plan(1), tmp_path, n_workers=0, work=label_or_fail)
    path = tmp_path / "plan.json"
    record = json.loads(path.read_text())
    del record["weights"]
    path.write_text(json.dumps(record))
    run_factory(plan(1), tmp_path, n_workers=0, work=label_or_fail)
    del record["seed"]
    path.write_text(json.dumps(record))
    with pytest.raises(ConfigError, match="begun with another plan.*seed"):
        run_factory(plan(1), tmp_path, n_workers=0, work=label_or_fail)
    weights = tmp_path / "some.safetensors"
    weights.write_bytes(b"one")
    chosen = replace(plan(1), weights=str(weights))
    with pytest.raises(ConfigError, match="begun with another plan.*weights"):
        run_factory(chosen, tmp_path, n_workers=0, work=label_or_fail)


def test_a_folder_holds_trials_of_one_kind(tmp_path, monkeypatch):
    run_factory(plan(1), tmp_path, n_workers=0, work=label_or_fail)
    fewer = replace(TRIAL_PRESETS["fast"], solver_iterations=7)
    monkeypatch.setitem(TRIAL_PRESETS, "fast", fewer)
    with pytest.raises(
        ConfigError, match="another plan.*trials.fast.solver_iterations"
    ):
        run_factory(plan(1), tmp_path, n_workers=0, work=label_or_fail)


def test_a_folder_that_does_not_say_how_it_tried_grasps_gets_none_more(tmp_path):
    path = tmp_path / "plan.json"
    for physics in (True, False):
        run_plan = replace(plan(1), physics=physics)
        path.unlink(missing_ok=True)
        run_factory(run_plan, tmp_path, n_workers=0, work=label_or_fail)
        record = json.loads(path.read_text())
        del record["trials"]
        path.write_text(json.dumps(record))
        if physics:
            with pytest.raises(ConfigError, match="does not say how"):
                run_factory(run_plan, tmp_path, n_workers=0, work=label_or_fail)
        else:
            run_factory(run_plan, tmp_path, n_workers=0, work=label_or_fail)


def test_weights_are_known_by_what_is_in_them(tmp_path):
    weights = [tmp_path / name for name in ("a", "b")]
    for path in weights:
        path.write_bytes(b"the same")
    out = tmp_path / "out"
    for path in weights:
        chosen = replace(plan(1), weights=str(path))
        run_factory(chosen, out, n_workers=0, work=label_or_fail)
    weights[1].write_bytes(b"others")
    with pytest.raises(ConfigError, match="begun with another plan.*weights"):
        run_factory(chosen, out, n_workers=0, work=label_or_fail)


def test_a_grippers_file_is_known_by_what_is_in_it(tmp_path):
    text = (Path(__file__).parents[2] / "docs/wide_gripper.yaml").read_text()
    files = [tmp_path / name for name in ("a.yaml", "b.yaml")]
    out = tmp_path / "out"
    for path in files:
        path.write_text(text)
        chosen = replace(plan(1), gripper=str(path))
        run_factory(chosen, out, n_workers=0, work=label_or_fail)
    files[1].write_text(text.replace("0.110", "0.100"))
    with pytest.raises(ConfigError, match="begun with another plan.*gripper"):
        run_factory(chosen, out, n_workers=0, work=label_or_fail)
