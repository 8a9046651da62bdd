# SPDX-License-Identifier: Apache-2.0
import argparse

import pytest

from neugrasp_ros.benchmark import runner
from neugrasp_ros.cli.bench import add_parser
from neugrasp_ros.errors import ConfigError


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_parser(parser.add_subparsers())
    return parser.parse_args(["bench", *words])


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--rounds", "0"], "--rounds must be positive, got 0"),
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
