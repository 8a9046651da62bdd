# SPDX-License-Identifier: Apache-2.0
import argparse
from types import SimpleNamespace

import pytest

from neugrasp_ros.benchmark.equivalence import ScoreCheck, score_figures
from neugrasp_ros.cli import score_check
from neugrasp_ros.cli.score_check import noted_scores, score_notes_path

PLANNER = SimpleNamespace(weights_sha256="abc")


@pytest.fixture
def args(tmp_path) -> argparse.Namespace:
    return argparse.Namespace(
        seed=1, grasps=2, candidates=4, gripper="panda", data=None,
        json=tmp_path / "profile.json",
    )  # fmt: skip


@pytest.fixture
def compared(monkeypatch):
    """The scenes that are compared; the third one stops the run, once."""
    asked = []

    def check_scores(planner, shots, *, n_grasps, seed, known, keep):
        checks = dict(known)
        for number in set(range(len(shots))) - set(known):
            if len(asked) == 2:
                asked.append("stopped")
                raise KeyboardInterrupt
            asked.append(number)
            checks[number] = ScoreCheck([0.01 * number], 0.0)
            keep(number, checks[number])
        return score_figures(list(checks.values()))

    monkeypatch.setattr(score_check, "check_scores", check_scores)
    return asked


def test_a_stopped_comparison_goes_on_where_it_was(args, compared, capsys):
    with pytest.raises(KeyboardInterrupt):
        noted_scores(args, PLANNER, [None] * 4)
    assert score_notes_path(args.json).exists()
    found = noted_scores(args, PLANNER, [None] * 4)
    assert compared == [0, 1, "stopped", 2, 3]
    assert found["scores_scenes"] == 4
    assert found["scores_mean_gap"] == pytest.approx(0.015)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [
        f"scores: {n} of 4 scenes" for n in (1, 2, 3, 4)
    ]
    assert lines[-1].endswith(" 0.0 min left")


def test_other_settings_begin_anew(args, compared):
    with pytest.raises(KeyboardInterrupt):
        noted_scores(args, PLANNER, [None] * 4)
    args.grasps = 3
    noted_scores(args, PLANNER, [None] * 4)
    assert compared == [0, 1, "stopped", 0, 1, 2, 3]
