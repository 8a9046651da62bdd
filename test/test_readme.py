# SPDX-License-Identifier: Apache-2.0
"""What README.md says of the benchmark is what ``results/`` holds."""

import json
import re
from pathlib import Path

import pytest

from neugrasp_ros.model import default_weights, load_network, quality_sha256

ROOT = Path(__file__).resolve().parent.parent
ROW = re.compile(r"`neugrasp (?P<command>bench [^`]*)`, `(?P<path>results/\S+\.json)`")
RATES = re.compile(
    r"GSR (?P<gsr>\S+) % \((?P<gsr_ci>\S+), (?P<attempts>\d+) attempts\), "
    r"DR (?P<dr>\S+) % \((?P<dr_ci>\S+?)\)"
)
ROWS = [row for row in (ROOT / "README.md").read_text().splitlines() if ROW.search(row)]


def options(command: str) -> set[tuple[str, str]]:
    """Return the options of a command, each with its value."""
    return set(re.findall(r"(--[\w-]+) ([^-]\S*)", command))


def test_the_readme_has_rows_of_the_benchmark():
    assert len(ROWS) >= 10


@pytest.mark.parametrize("row", ROWS, ids=lambda row: ROW.search(row)["path"])
def test_a_row_says_what_its_file_holds(row):
    found, said = ROW.search(row), RATES.search(row)
    report = json.loads((ROOT / found["path"]).read_text())
    assert said["attempts"] == str(report["attempts"])
    for name in ("gsr", "dr"):
        assert said[name] == f"{report[name]:.1f}"
        assert said[f"{name}_ci"] == "{:.1f}-{:.1f}".format(*report[f"{name}_ci"])
    iou = re.search(r"IoU (\S+) %", row)
    assert iou is None or float(iou[1]) == pytest.approx(report["iou"], abs=0.5)
    assert options(found["command"]) <= options(report["command"])


def test_validation_is_of_the_shipped_quality():
    report = json.loads((ROOT / "results/evaluate_val.json").read_text())
    network, _ = load_network(default_weights())
    assert report["quality_sha256"] == quality_sha256(network)
