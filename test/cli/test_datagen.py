# SPDX-License-Identifier: Apache-2.0
import argparse
import json
import sys

import pytest

from neugrasp_ros.cli import datagen
from neugrasp_ros.datagen import factory
from neugrasp_ros.errors import ConfigError, NeuGraspError
from neugrasp_ros.model import default_weights
from sim_bridge.objects import registry


def parse(*words):
    parser = argparse.ArgumentParser()
    datagen.add_parser(parser.add_subparsers())
    return parser.parse_args(["datagen", *words])


@pytest.fixture
def calls(monkeypatch):
    seen = []

    def fake(plan, folder, **kwargs):
        seen.append((plan, folder, kwargs))
        progress = factory.Progress(plan.n_scenes, n_done=plan.n_scenes)
        progress.skipped += ["scene 3: why"] * (plan.seed == 9)
        kwargs["report"](progress)
        return progress

    monkeypatch.setattr(factory, "run_factory", fake)
    monkeypatch.setattr(registry, "object_set", lambda name: None)
    monkeypatch.setattr(registry, "part_names", lambda objects, part: ("a",))
    return seen


def test_words_become_a_plan(calls, capsys):
    args = parse(
        "--out", "d", "--objects", "pile:x,packed:y", "--gripper", "panda",
        "--scenes", "7", "--seed", "4", "--workers", "3", "--split", "tune",
        "--no-physics", "--count", "2",
    )  # fmt: skip
    assert args.run(args) == 0
    plan, folder, kwargs = calls[0]
    assert plan.objects == ("pile:x", "packed:y")
    assert (plan.gripper, plan.n_scenes, plan.seed, plan.split) == (
        "panda",
        7,
        4,
        "tune",
    )
    assert not plan.physics
    assert {job.count for job in plan.jobs()} == {2}
    assert folder == "d"
    assert (kwargs["n_workers"], kwargs["dask_address"]) == (3, None)
    assert "7/7 scenes" in capsys.readouterr().out


def test_a_network_chooses_only_when_asked(calls):
    for words in (
        ("--trials", "9", "--collisions", "50"),
        ("--chosen",),
        ("--chosen", "--weights", "w"),
    ):
        args = parse("--out", "d", *words)
        assert args.run(args) == 0
    drawn, shipped, given = (plan for plan, _, _ in calls)
    assert drawn.weights == ""
    assert (drawn.candidates.n_trials, drawn.candidates.n_collisions) == (9, 50)
    assert shipped.weights == str(default_weights())
    assert given.weights == "w"


@pytest.mark.parametrize("words", [("--collisions", "-1"), ("--chosen",)])
def test_collisions_that_make_no_sense_are_refused(calls, words):
    args = parse("--out", "d", "--collisions", "5", *words)
    with pytest.raises(ConfigError, match="--collisions: expected 0 or more"):
        args.run(args)
    assert not calls
    none = parse("--out", "d", "--collisions", "0")
    assert none.run(none) == 0
    assert calls[0][0].candidates.n_collisions == 0


def test_counts_and_rates_are_written(calls, monkeypatch, tmp_path):
    written = []
    words = ["neugrasp", "datagen", "--objects", "pile:/secret/a,b", "--out", "runs/x"]
    monkeypatch.setattr(sys, "argv", words)

    def half_done(plan, folder, **kwargs):
        progress = factory.Progress(10, n_done=5, seconds=360.0, _n_before=2)
        progress.n_trials, progress.n_labels = 60, 90
        kwargs["report"](progress)
        written.append(json.loads((tmp_path / "f.json").read_text()))
        progress.n_trials = 120
        return progress

    monkeypatch.setattr(factory, "run_factory", half_done)
    args = parse("--out", "d", "--seed", "3", "--json", str(tmp_path / "f.json"))
    assert args.run(args) == 0
    written.append(json.loads((tmp_path / "f.json").read_text()))
    assert [f["trials_per_hour"] for f in written] == [600, 1200]
    assert [f["labels_per_hour"] for f in written] == [900, 900]
    assert (written[0]["seed"], written[0]["seconds"]) == (3, 360.0)
    counts = [written[1][key] for key in ("scenes_of_plan", "scenes_before", "scenes")]
    assert counts == [10, 2, 3]
    assert (
        written[1]["command"] == "neugrasp datagen --objects pile:$DIR/a,b --out runs/x"
    )


def test_lost_scenes_are_named_and_change_the_exit_code(calls, capsys):
    args = parse("--out", "d", "--seed", "9")
    assert args.run(args) == 1
    assert "skipped scene 3: why" in capsys.readouterr().out


def test_the_engine_needs_an_address_when_it_is_dask(calls):
    args = parse("--out", "d", "--engine", "dask", "tcp://host:1")
    assert args.run(args) == 0
    assert calls[0][2]["dask_address"] == "tcp://host:1"
    for words in (["dask"], ["ray", "x"], ["local", "x"]):
        args = parse("--out", "d", "--engine", *words)
        with pytest.raises(ConfigError, match="--engine"):
            args.run(args)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--weights", "w"), "give --chosen too"),
        (("--trials", "0"), "--trials must be positive, got 0"),
        (("--scenes", "-1"), "--scenes must be positive, got -1"),
        (("--workers", "0"), "--workers must be positive, got 0"),
        (("--seed", "-1"), "seed must be 0 or more, got -1"),
        (("--count", "-1"), "count must be 0 or more, got -1"),
    ],
)
def test_what_makes_no_sense_is_refused(calls, words, message):
    args = parse("--out", "d", *words)
    with pytest.raises(ConfigError, match=message):
        args.run(args)
    assert not calls


@pytest.mark.parametrize(
    ("objects", "words"),
    [("procedural,nonsense", "unknown object set 'nonsense'"), ("procedural@x", "'x'")],
)
def test_an_unknown_set_is_refused_before_the_folder_is_bound(tmp_path, objects, words):
    args = parse("--out", str(tmp_path / "d"), "--objects", objects)
    with pytest.raises(NeuGraspError, match=words):
        args.run(args)
    assert not (tmp_path / "d").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--objects", "nothing"), "unknown object set 'nothing'"),
        (("--gripper", "pandda"), "unknown gripper 'pandda'"),
        (("--split", "held_out"), "the part 'held_out' of 'procedural' is empty"),
    ],
)
def test_what_is_not_there_is_refused_before_the_folder_is_bound(
    words, message, tmp_path
):
    out = tmp_path / "data"
    args = parse("--out", str(out), "--objects", "procedural", *words)
    with pytest.raises(NeuGraspError, match=message):
        args.run(args)
    assert not out.exists()
