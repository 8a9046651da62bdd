# SPDX-License-Identifier: Apache-2.0
import argparse
import json

import pytest

from neugrasp_ros.benchmark import runner
from neugrasp_ros.benchmark.records import AttemptRecord, RoundRecord
from neugrasp_ros.cli.bench import add_parser
from neugrasp_ros.errors import ConfigError, SimulationError


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    return parser.parse_args(["bench", *words])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--rounds", "0"], "--rounds must be positive, got 0"),
        (["--probes", "-1"], "--probes must be positive, got -1"),
        (["--candidates", "23"], "--candidates must be at least 24, .*, got 23"),
    ],
)
def test_what_cannot_be_meant_is_refused(words, sentence):
    args = parse(*words)
    with pytest.raises(ConfigError, match=sentence):
        args.run(args)


def test_each_probe_tries_as_many_candidates_as_were_asked_for(monkeypatch):
    monkeypatch.setattr(
        runner, "probe_scene", lambda _, index, __, n_candidates: (index, n_candidates)
    )
    probes = runner.run_probes(None, [3, 4], lambda: (None, None), n_candidates=96)
    assert list(probes) == [(3, 96), (4, 96)]


ATTEMPT = AttemptRecord(
    round_index=0, number=0, reason="", quality=0.9, T_task_gripper=(0.0,) * 12,
    opening=0.08, width=0.04, stop_depth=0.0, object_name="one", n_candidates=9,
    n_grasps=1,
)  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "missing"), [((), [2, 3]), (("--seed", "1"), [0, 1, 2, 3])]
)
def test_a_run_that_was_stopped_goes_on_with_the_rounds_it_lacks(
    monkeypatch, tmp_path, changes, missing
):
    asked = []

    def rounds(suite, indices, setup, workers):
        asked.append(indices)
        for index in indices:
            if len(asked) == 1 and index == 2:
                raise SimulationError("a worker died")
            yield RoundRecord(
                index=index, n_objects=1, n_uncounted=0, ended="cleared",
                attempts=(ATTEMPT,), scene={},
            )  # fmt: skip

    monkeypatch.setattr(runner, "run_suite", rounds)
    report = tmp_path / "bench.json"
    words = ("--rounds", "4", "--json", str(report))
    with pytest.raises(SimulationError):
        parse(*words).run(parse(*words))
    again = parse(*words, *changes)
    assert again.run(again) == 0
    assert asked == [[0, 1, 2, 3], missing]
    assert json.loads(report.read_text())["attempts"] == 4
    assert list(tmp_path.iterdir()) == [report]
