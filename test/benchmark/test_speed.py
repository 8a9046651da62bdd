# SPDX-License-Identifier: Apache-2.0
import subprocess
import sys

import numpy as np
import pytest

from neugrasp_ros.benchmark import speed
from neugrasp_ros.benchmark.speed import (
    STAGES,
    matmul_ms,
    peak_memory_mb,
    resident_mb,
    summary,
)
from neugrasp_ros.benchmark.speed_figures import draw_profile, profile_table


@pytest.fixture
def rows() -> list[dict[str, float]]:
    names = (*STAGES, "requery", "total", "cpu", "queries", "candidates", "cubes")
    return [dict.fromkeys(names, float(n)) for n in range(11)]


def test_a_summary_has_medians_and_ninetieth_percentiles(rows):
    found = summary(rows)
    assert found["total_ms_median"] == 5.0
    assert found["total_ms_p90"] == 9.0
    assert found["stages_ms"]["fusion"] == {"median": 5.0, "p90": 9.0}
    assert found["requery_ms_median"] == 5.0
    assert found["scenes"] == 11


def test_the_run_with_the_least_median_counts_and_all_are_kept(rows, monkeypatch):
    speeds = iter([3.0, 1.0, 2.0])
    products = iter([2.2, 2.0, 2.1])

    def run(_, shots, repeats):
        assert (shots, repeats) == (["a shot"], 1)
        factor = next(speeds)
        return [{name: factor * value for name, value in row.items()} for row in rows]

    monkeypatch.setattr(speed, "best_of", run)
    monkeypatch.setattr(speed, "matmul_ms", lambda: next(products))
    found = speed.best_run(None, ["a shot"], 3)
    assert found["total_ms_median"] == 5.0 and found["total_ms_p90"] == 9.0
    assert found["runs_total_ms_median"] == [15.0, 5.0, 10.0]
    assert found["runs_total_ms_p90"] == [27.0, 9.0, 18.0]
    assert found["runs_matmul_512_ms"] == [2.2, 2.0, 2.1]
    assert "matmul_512_ms" not in found


def test_the_machine_is_measured():
    assert 0 < matmul_ms() < 1000
    grown = np.ones(30_000_000)
    assert peak_memory_mb() > grown.nbytes / 2**20


def test_a_table_names_every_stage_and_a_picture_is_drawn(rows, tmp_path):
    found = summary(rows) | {"speedup_scoring": 100.0}
    text = profile_table(found)
    assert all(name in text for name in (*STAGES, "total", "speedup_scoring"))
    draw_profile(found, tmp_path / "new" / "profile.png")
    assert (tmp_path / "new" / "profile.png").stat().st_size > 2000


def test_a_run_of_other_parts_has_a_table_too():
    assert profile_table({"scores_mean_gap": 0.01, "seed": 0}) == "scores_mean_gap 0.01"


def test_another_process_is_asked_for_its_memory():
    child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    try:
        resident, peak = resident_mb(child.pid), peak_memory_mb(child.pid)
    finally:
        child.communicate(b"\n")
    assert 0 < resident <= peak + 1 < peak_memory_mb()
