# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from neugrasp_ros.benchmark.table import load_results, markdown_table
from neugrasp_ros.errors import ConfigError


def result(**changes):
    values = {
        "scene": "pile", "view": "random", "gsr": 91.25, "dr": 80.0, "attempts": 80,
        "rounds": 20, "policy": "neugrasp", "gripper": "panda", "protocol": "vgn",
        "suite_objects": "pile_train",
    }  # fmt: skip
    return values | changes


def cells(table, start):
    (line,) = [x for x in table.splitlines() if x.startswith(f"| {start}")]
    return [cell.strip() for cell in line.strip("|").split("|")]


def test_our_cell_stands_under_the_papers_column():
    table = markdown_table([result(), result(view="hard", rounds=5, gsr=None)])
    header, ours = cells(table, "GSR/DR"), cells(table, "neugrasp, panda, vgn")
    assert ours[header.index("pile random")] == "91.2/80.0 (n=80)"
    assert ours[header.index("pile hard")] == "-/80.0 (n=80)"
    assert ours[header.index("packed fixed")] == "-"
    paper = cells(table, "NeuGraspNet (paper)")
    assert paper[header.index("packed hard")] == "78.8/82.8"


def test_the_longer_run_of_a_cell_counts_and_grippers_have_their_own_rows():
    table = markdown_table(
        [result(rounds=100, gsr=90.0), result(rounds=10), result(gripper="mine")]
    )
    assert "90.0/80.0 (n=80)" in cells(table, "neugrasp, panda")
    assert "91.2/80.0 (n=80)" in cells(table, "neugrasp, mine")


def test_results_are_found_below_a_folder_and_others_passed_over(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "one.json").write_text(json.dumps(result()))
    (tmp_path / "other.json").write_text(json.dumps({"hz": 10}))
    assert load_results(tmp_path) == [result()]
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(ConfigError, match="bad.json"):
        load_results(tmp_path)
    with pytest.raises(ConfigError, match="holds no result"):
        load_results(tmp_path / "none")
