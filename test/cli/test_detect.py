# SPDX-License-Identifier: Apache-2.0
"""``neugrasp detect`` and ``neugrasp up`` as a user runs them."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.cli.detect import _table  # noqa: E402
from neugrasp_ros.cli.main import main  # noqa: E402
from neugrasp_ros.model import default_weights  # noqa: E402

pytestmark = pytest.mark.ros

START = 240.0  # [s]; the first start on a machine compiles code


def neugrasp(*words: str, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "neugrasp_ros.cli.main", *words],
        capture_output=True,
        text=True,
        timeout=timeout,
    )


def test_without_a_suite_it_says_so_and_ends_with_two(domain):
    ended = neugrasp("detect", "--timeout", "1")
    assert ended.returncode == 2
    assert "nobody offers" in ended.stdout and "neugrasp up" in ended.stdout
    ended = neugrasp("detect", "--timeout", "1", "--json")
    assert ended.returncode == 2 and "error" in json.loads(ended.stdout)


@pytest.mark.parametrize("option", ["--max-grasps", "--seed"])
def test_numbers_that_no_message_holds_are_wrong_usage(option, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["detect", option, "-3"])
    assert ended.value.code == 64


@pytest.mark.parametrize("text", ["nan", "inf", "-3", "0", "1e12"])
def test_a_time_that_nobody_can_wait_is_wrong_usage(text, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["detect", f"--timeout={text}"])
    assert ended.value.code == 64
    assert f"expected seconds above 0, at most 1000000, got {text}" in (
        capsys.readouterr().err
    )


def test_a_namespace_that_ros_cannot_take_is_one_sentence(domain):
    ended = neugrasp("detect", "--timeout", "1", "--ns", "/two words")
    assert ended.returncode == 1
    assert ended.stderr.startswith("neugrasp: namespace '/two words': ")
    assert "Traceback" not in ended.stderr


def ready(words: list[str]) -> dict:
    """Ask until the suite has started; return the first real answer."""
    deadline = time.monotonic() + START
    while time.monotonic() < deadline:
        ended = neugrasp("detect", "--json", "--timeout", "60", *words)
        answer = json.loads(ended.stdout)
        if answer.get("code") not in (None, "NOT_ACTIVE", "NO_DEPTH"):
            return answer | {"returncode": ended.returncode}
    raise AssertionError(f"the suite did not start in {START} s: {ended.stdout}")


@pytest.mark.slow
@pytest.mark.skipif(not default_weights().is_file(), reason="no trained weights yet")
@pytest.mark.parametrize("separate", [[], ["--separate"]])
def test_the_suite_of_processes_answers_with_the_real_network(
    domain, separate, tmp_path
):
    command = [sys.executable, "-m", "neugrasp_ros.cli.main", "up", "--sim", *separate]
    path = tmp_path / "up.log"
    with path.open("w") as log:
        suite = subprocess.Popen(
            [*command, "-p", "sim_bridge:kind:=packed", "-p", "sim_bridge:seed:=1"],
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    try:
        answer = ready(["--min-quality", "0", "--max-grasps", "3"])
        assert answer["counts"]["views"] >= 1
        if answer["grasps"]:
            assert answer["returncode"] == 0 and answer["code"] == "NONE"
            assert len(answer["grasps"]) <= 3 and answer["grasps"][0]["arm"]
            assert answer["frame_id"] == "base_footprint"
        else:
            assert answer["returncode"] == 1 and answer["message"]
    finally:
        os.kill(suite.pid, signal.SIGINT)
        code = suite.wait(60)
    assert code == 0, path.read_text()


def test_an_answer_says_what_each_grasp_is_good_for_and_how_many_were_left():
    grasp = {
        "id": "g1", "position": [0.1, 0.2, 0.3], "width": 0.08, "quality": 0.9,
        "arm": "left", "affordance_scores": [0.2, 0.7],
    }  # fmt: skip
    answer = {
        "code": "NONE", "message": "2 grasps", "frame_id": "base", "tcp_frame": "tcp",
        "affordance_labels": ["cut", "pour"], "seconds": {"total": 0.5},
        "counts": {"sampled": 40, "after_affordance": 2},
        "grasps": [grasp, {**grasp, "id": "g2", "affordance_scores": [0.2, 0.3]}],
    }  # fmt: skip
    lines = _table(answer).splitlines()
    assert lines[1] == "sampled 40, after_affordance 2"
    assert lines[-3].split()[-2:] == ["pour", "0.70"]
    assert lines[-2].endswith("not known")
    answer["affordance_labels"] = []
    assert "not known" not in _table(answer)
