# SPDX-License-Identifier: Apache-2.0
import argparse
import json

import pytest

from neugrasp_ros.cli import profile
from neugrasp_ros.errors import ConfigError


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    profile.add_parser(parser.add_subparsers())
    return parser.parse_args(["profile", *words])


@pytest.fixture
def measured(monkeypatch):
    """No scene is shot and nothing is timed; every part says its name."""
    monkeypatch.setattr(profile, "_shots", lambda args, wanted: ([], []))
    monkeypatch.setattr(
        profile, "_part", lambda name, *_: lambda: {f"{name}_figure": 1.0}
    )
    monkeypatch.setattr("neugrasp_ros.benchmark.speed.best_of", lambda *_, **__: None)
    monkeypatch.setattr("neugrasp_ros.benchmark.speed.matmul_ms", lambda: 2.0)


def test_each_part_says_how_it_was_made_and_is_kept(measured, tmp_path, capsys):
    path = tmp_path / "profile.json"
    args = parse("--only", "rays, scores", "--threads", "1", "--json", str(path))
    assert args.run(args) == 0
    args = parse("--only", "curves", "--seed", "3", "--json", str(path), "--merge")
    assert args.run(args) == 0
    result = json.loads(path.read_text())
    assert result["rays_figure"] == result["curves_figure"] == 1.0
    assert set(result["commands"]) == {"rays", "scores", "curves"}
    assert result["commands"]["rays"]["threads"] == 1
    assert result["commands"]["curves"]["seed"] == 3
    assert "rays" in capsys.readouterr().out


def test_what_was_measured_is_kept_when_a_later_part_fails(
    measured, tmp_path, monkeypatch
):
    def fail():
        raise RuntimeError("no more memory")

    monkeypatch.setattr(
        profile, "_part", lambda name, *_: fail if name == "scores" else dict
    )
    path = tmp_path / "profile.json"
    args = parse("--only", "rays,scores", "--json", str(path))
    with pytest.raises(RuntimeError, match="no more memory"):
        args.run(args)
    assert set(json.loads(path.read_text())["commands"]) == {"rays"}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--only", "rays,speed"], r"--only: expected of timing.*, got \['speed'\]"),
        (["--rays", "0"], "--rays must be positive, got 0"),
        (["--detections", "-1"], "--detections must be positive, got -1"),
        (["--repeat", "0"], "--repeat must be positive, got 0"),
        (["--requests", "0"], "--requests must be positive, got 0"),
        (["--merge"], "--merge needs --json"),
    ],
)
def test_what_cannot_be_meant_is_refused(measured, words, sentence):
    args = parse(*words)
    with pytest.raises(ConfigError, match=sentence):
        args.run(args)


def test_figures_of_other_weights_are_not_mixed(measured, tmp_path):
    path = tmp_path / "profile.json"
    path.write_text(json.dumps({"weights_sha256": "another"}))
    args = parse("--only", "rays", "--json", str(path), "--merge")
    with pytest.raises(ConfigError, match="is of the weights another"):
        args.run(args)
