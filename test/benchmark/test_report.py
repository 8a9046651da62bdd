# SPDX-License-Identifier: Apache-2.0
"""Reports say what was run, and nothing about where."""

import json
import sys
from pathlib import Path

from diamond import SMALL_NETWORK

from neugrasp_ros.benchmark.protocol import Suite
from neugrasp_ros.benchmark.records import AttemptRecord, RoundRecord
from neugrasp_ros.benchmark.report import command_line, figures, say, write_report
from neugrasp_ros.model import GraspNetwork, save_network


def _round(index: int, reasons: tuple[str, ...]) -> RoundRecord:
    attempts = tuple(
        AttemptRecord(
            round_index=index,
            number=number,
            reason=reason,
            quality=0.8,
            T_task_gripper=(0.0,) * 12,
            opening=0.08,
            width=0.02,
            stop_depth=0.0,
            object_name="" if reason else "mug",
            n_candidates=100,
            n_grasps=10,
            timings={"plan": 0.1},
        )
        for number, reason in enumerate(reasons)
    )
    return RoundRecord(
        index=index,
        n_objects=3,
        n_uncounted=0,
        ended="failures",
        attempts=attempts,
        scene={},
    )


def test_figures_count_name_and_hide(tmp_path: Path) -> None:
    weights = tmp_path / "some.safetensors"
    save_network(GraspNetwork(SMALL_NETWORK), weights)
    rounds = [_round(0, ("", "empty")), _round(1, ("", ""))]
    suite = Suite(objects="/secret/place/pile_train", seed=7)
    command = "neugrasp bench --objects /secret/place/pile_train --seed 7"

    result = figures(suite, "neugrasp", rounds, str(weights), command)
    assert result["gsr"] == 75.0
    assert result["dr"] == 50.0
    assert result["attempts"] == 4
    assert result["seed"] == 7
    assert len(result["weights_sha256"]) == len(result["quality_sha256"]) == 64
    assert "secret" not in json.dumps(result)

    path = tmp_path / "results" / "x.json"
    write_report(path, result)
    assert json.loads(path.read_text()) == json.loads(json.dumps(result))


def test_the_line_for_people_adds_up() -> None:
    line = say([_round(0, ("", "empty"))], 10)
    assert line.startswith("round 1/10: 1/2 attempts, 1/3 objects")


def test_the_command_line_names_no_folder_of_this_machine(monkeypatch):
    monkeypatch.setattr(
        sys, "argv", ["cli/main.py", "evaluate", "--json", "/secret/place/val.json"]
    )
    assert command_line() == "neugrasp evaluate --json $DIR/val.json"
