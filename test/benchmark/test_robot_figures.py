# SPDX-License-Identifier: Apache-2.0
import json

import pytest

from neugrasp_ros.benchmark.robot_figures import (
    by_kind,
    keep_round,
    load_rounds,
    round_path,
    summarize_rounds,
)
from neugrasp_ros.errors import ConfigError


def attempt(outcome="GRASPED", cleared="cup#1", *, executed=True, message="lifted"):
    return {
        "outcome": outcome,
        "message": message,
        "executed": executed,
        "cleared": cleared,
        "held": outcome in ("GRASPED", "LOST"),
        "planning": [0.2, 0.4],
    }


def record(index, attempts, *, kind="table:pile", cleared=1, force=0.0, speed=0.5):
    return {
        "index": index,
        "kind": kind,
        "objects": ["a", "b"],
        "cleared": ["a", "b"][:cleared],
        "ended": "cleared" if cleared == 2 else "no_grasp",
        "attempts": attempts,
        "skips": ["NONE_REACHABLE 3 NO_IK"] if cleared < 2 else [],
        "largest_contact": force,
        "contact_link": "arm_left_7_link" if force else "",
        "limits": {
            "position": 0.0,
            "velocity": speed,
            "acceleration": 0.9,
            "jerk": 1.0,
            "samples": 10,
        },
        "simulated": 30.0,
        "wall": 60.0,
    }


def test_only_what_moved_an_arm_counts_as_executed():
    refused = attempt("UNREACHABLE", "", executed=False, message="no arm posture")
    missed = attempt("MISSED", "", message="the jaws closed on nothing")
    found = summarize_rounds([record(0, [attempt(), refused, missed])])
    assert (found["asked"], found["executed"]) == (3, 2)
    assert found["held"]["count"] == 1 and found["held"]["percent"] == 50.0
    low, high = found["held"]["ci"]
    assert low == pytest.approx(9.45, abs=0.01) and high == pytest.approx(90.55, 0.001)
    assert sum(found["failures"].values()) == 2


def test_what_was_held_and_lost_on_the_way_is_held_but_not_in_the_box():
    found = summarize_rounds([record(0, [attempt("LOST", "", message="not in it")])])
    assert found["held"]["count"] == 1 and found["in_the_box"]["count"] == 0
    assert found["failures"] == {"LOST: not in it": 1}


def test_reasons_that_differ_only_in_numbers_are_one_reason():
    behind = [attempt("ABORTED", "", message=f"{v} behind") for v in (0.15, 0.27)]
    assert summarize_rounds([record(0, behind)])["failures"] == {
        "ABORTED: #.## behind": 2
    }


def test_the_worst_force_and_limits_of_all_rounds_are_told():
    rounds = [record(0, [attempt()], force=3.0, speed=0.7), record(1, [], force=25.0)]
    found = summarize_rounds(rounds)
    assert found["contact_newton"]["largest"] == 25.0
    assert found["contact_newton"]["rounds_above_20"] == 1
    assert found["limits"]["velocity"] == 0.7 and found["limits"]["samples"] == 20
    assert found["planning_seconds"]["median"] == pytest.approx(0.3)
    assert found["cleared"] == 2 and found["objects"] == 4


def test_without_an_attempt_there_is_no_rate_and_no_planning_time():
    found = summarize_rounds([record(0, [], cleared=0)])
    assert found["held"]["percent"] is None
    assert found["planning_seconds"] == {"count": 0}
    assert found["no_grasp"] == {"NONE_REACHABLE": 1}


def test_furniture_is_told_apart():
    rounds = [record(0, [attempt()]), record(1, [], kind="shelf:packed", cleared=2)]
    found = by_kind(rounds)
    assert found["shelf:packed"]["cleared"] == 2
    assert found["table:pile"]["executed"] == 1


def kept(index, **changes):
    return {**record(index, [attempt()]), "weights_sha256": "abc", **changes}


def test_rounds_are_kept_whole_and_come_back_in_order(tmp_path):
    rounds = {index: kept(index, seed=7 + index) for index in (3, 1, 2)}
    for made in rounds.values():
        keep_round(tmp_path, made)
    assert round_path(tmp_path, 3).exists() and not list(tmp_path.glob("*.part"))
    loaded = load_rounds(tmp_path, 3, 7, "abc")
    assert loaded == json.loads(json.dumps([rounds[1], rounds[2]]))


@pytest.mark.parametrize(
    ("seed", "weights", "message"),
    [(8, "abc", "seed is 8, this run's is 9"), (7, "def", "weights_sha256 is abc")],
)
def test_rounds_of_another_run_are_refused(seed, weights, message, tmp_path):
    keep_round(tmp_path, kept(1, seed=8))
    with pytest.raises(ConfigError, match=message):
        load_rounds(tmp_path, 30, seed, weights)


def test_an_empty_folder_has_no_rounds_and_a_damaged_one_is_refused(tmp_path):
    assert load_rounds(tmp_path, 30, 0, "abc") == []
    round_path(tmp_path, 0).write_text("{")
    with pytest.raises(ConfigError, match="not JSON"):
        load_rounds(tmp_path, 30, 0, "abc")
