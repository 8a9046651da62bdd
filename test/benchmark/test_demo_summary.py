# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from neugrasp_ros.benchmark.demo_summary import load_demos, summarize_demos
from neugrasp_ros.errors import ConfigError


def demo(seed, outcomes, weights="a"):
    return {
        "seed": seed,
        "objects": 5,
        "lifted": sum(outcomes),
        "attempts": [
            {"success": ok, "result": "lifted" if ok else "empty"} for ok in outcomes
        ],
        "milliseconds": [{"total": 100.0 * (seed + 1)}],
        "weights_sha256": weights,
        "commit": f"c{seed}",
    }


def write(folder, *demos):
    for number, item in enumerate(demos):
        (folder / f"{number}.json").write_text(json.dumps(item))


def test_attempts_and_objects_are_pooled(tmp_path):
    write(tmp_path, demo(1, [True, True, False]), demo(0, [False, False]))
    (tmp_path / "other.json").write_text('{"hz": 10}')
    figures = summarize_demos(load_demos(tmp_path))
    assert figures["seeds"] == [0, 1]
    assert (figures["successes"], figures["attempts"]) == (2, 5)
    assert figures["success_percent"] == pytest.approx(40.0)
    low, high = figures["success_ci"]
    assert low == pytest.approx(11.76, abs=0.01)
    assert high == pytest.approx(76.93, abs=0.01)
    assert (figures["lifted"], figures["objects"]) == (2, 10)
    assert figures["demos_with_a_lift"] == 1
    assert figures["results"] == {"lifted": 2, "empty": 3}
    assert figures["milliseconds"]["total"]["median"] == 150.0
    assert figures["commit"] == "c0, c1"


def test_mixed_weights_and_empty_or_damaged_folders_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="holds no result"):
        load_demos(tmp_path)
    write(tmp_path, demo(0, [True]), demo(1, [True], weights="b"))
    with pytest.raises(ConfigError, match="2 weights files"):
        load_demos(tmp_path)
    (tmp_path / "9.json").write_text("{")
    with pytest.raises(ConfigError, match="9.json"):
        load_demos(tmp_path)
