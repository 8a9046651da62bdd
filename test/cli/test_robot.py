# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from neugrasp_ros.cli.main import main
from neugrasp_ros.cli.robot import parse_share
from neugrasp_ros.model import default_weights, file_sha256


def test_a_share_is_counted_from_one():
    assert parse_share("2/3") == (2, 3)


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/"])
def test_a_share_that_cannot_be_ends_with_a_sentence(text, tmp_path, capsys):
    assert main(["robot", "clear", "--share", text, "--keep", str(tmp_path)]) == 1
    assert "--share must be K/N" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("reach --sets 0", "--sets must be positive, got 0"),
        ("reach --slow-sets -1", "--slow-sets must be 0 or more, got -1"),
        ("order --scenes 0", "--scenes must be positive, got 0"),
        ("order --candidates -5", "--candidates must be positive, got -5"),
        ("order --budgets 0.1 -1", "--budgets must be 0 or more seconds, got -1.0"),
        ("order --budgets nan", "--budgets must be 0 or more seconds, got nan"),
    ],
)
def test_what_cannot_be_measured_ends_with_a_sentence(words, sentence, capsys):
    assert main(["robot", *words.split()]) == 1
    assert sentence in capsys.readouterr().err


def test_rounds_that_are_kept_are_pooled_and_not_run_again(tmp_path, capsys):
    round_ = {
        "index": 0, "seed": 5, "weights_sha256": file_sha256(default_weights()),
        "kind": "table:pile", "objects": ["a"], "cleared": ["a"],
        "ended": "cleared", "attempts": [], "skips": [], "largest_contact": 1.5,
        "contact_link": "x", "simulated": 1.0, "wall": 2.0,
        "limits": {
            "position": 0, "velocity": 0.5, "acceleration": 0, "jerk": 0, "samples": 1
        },
    }  # fmt: skip
    (tmp_path / "round_000.json").write_text(json.dumps(round_))
    path = tmp_path / "figures.json"
    arguments = ["--rounds", "1", "--keep", str(tmp_path), "--json", str(path)]
    assert main(["robot", "clear", *arguments, "--seed", "6"]) == 1
    assert "seed is 5, this run's is 6" in capsys.readouterr().err
    assert main(["robot", "clear", *arguments, "--seed", "5"]) == 0
    figures = json.loads(path.read_text())
    assert figures["cleared"] == 1 and figures["contact_newton"]["largest"] == 1.5
    assert len(figures["weights_sha256"]) == 64 and figures["command"]
    assert "cleared: 1" in capsys.readouterr().out
