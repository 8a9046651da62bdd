# SPDX-License-Identifier: Apache-2.0
import os
from types import SimpleNamespace

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.benchmark.speed import resident_mb  # noqa: E402
from neugrasp_ros.cli import suite_memory  # noqa: E402
from neugrasp_ros.cli.suite_memory import by_memory  # noqa: E402
from neugrasp_ros.config import PlannerConfig  # noqa: E402


def test_memory_is_read_after_a_tenth_of_the_answers_and_at_the_end(
    monkeypatch, capsys
):
    hoard = []

    def asked(commands, shots, requests, after):
        assert len(commands) == 1 and shots == ["a scene"]
        for answers in range(1, requests + 1):
            hoard.append(bytearray(os.urandom(2**20)) if answers > 2 else None)
            after({"neugrasp": SimpleNamespace(pid=os.getpid())}, answers)
        return {"n": requests, "failed": 0}

    monkeypatch.setattr(suite_memory, "asked", asked)
    before = resident_mb()
    found = by_memory(["a scene"], 20, PlannerConfig())["memory_composed"]
    assert found["n"] == found["detections_late"] == 20
    assert found["detections_early"] == 2
    assert found["rss_early_mb"] == pytest.approx(before, abs=5)
    assert found["rss_late_mb"] - found["rss_early_mb"] == pytest.approx(18, abs=3)
    assert found["rss_growth"] == found["rss_late_mb"] / found["rss_early_mb"] > 1
    assert found["peak_mb"] >= found["rss_late_mb"] - 1
    assert capsys.readouterr().err.count("of 20 answers") == 10
