# SPDX-License-Identifier: Apache-2.0
from types import SimpleNamespace

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.cli import suite_memory  # noqa: E402
from neugrasp_ros.cli.suite_memory import by_memory  # noqa: E402
from neugrasp_ros.config import PlannerConfig  # noqa: E402

SUITE = {"neugrasp": SimpleNamespace(pid=77)}


def test_memory_is_read_after_a_tenth_of_the_answers_and_at_the_end(
    monkeypatch, capsys
):
    grown = [500.0]

    def asked(commands, shots, requests, after, pause):
        assert len(commands) == 1 and shots == ["a scene"]
        for answers in range(1, requests + 1):
            grown[0] += 1.0
            after(SUITE, answers)
        return {"n": requests, "failed": 0}

    def resident_mb(process):
        assert process == 77
        return grown[0]

    monkeypatch.setattr(suite_memory, "asked", asked)
    monkeypatch.setattr(suite_memory, "resident_mb", resident_mb)
    monkeypatch.setattr(suite_memory, "peak_memory_mb", lambda p: resident_mb(p) + 9)
    found = by_memory(["a scene"], 20, PlannerConfig())["memory_composed"]
    assert found == {
        "n": 20,
        "failed": 0,
        "detections_early": 2,
        "detections_late": 20,
        "rss_early_mb": 502.0,
        "rss_late_mb": 520.0,
        "rss_growth": 520.0 / 502.0,
        "peak_mb": 529.0,
    }
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 10
    assert lines[-1] == "memory: 20 of 20 answers, 520 MB"
