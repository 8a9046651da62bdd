# SPDX-License-Identifier: Apache-2.0
import os
import signal
import sys
import threading
import time

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.cli import service_latency  # noqa: E402
from neugrasp_ros.cli.processes import Command  # noqa: E402
from neugrasp_ros.cli.service_latency import (  # noqa: E402
    asked,
    by_service,
    suite_commands,
)
from neugrasp_ros.config import PlannerConfig  # noqa: E402
from neugrasp_ros.nodes import service_probe  # noqa: E402
from neugrasp_ros.nodes.client import NoAnswerError  # noqa: E402

SLEEPER = (sys.executable, "-c", "import time; time.sleep(60)")


@pytest.mark.parametrize(("separate", "count"), [(False, 1), (True, 5)])
def test_the_suite_gets_what_the_profile_records(separate, count):
    config = PlannerConfig(
        weights="my.safetensors", gripper="panda", threads=1, max_candidates=64
    )
    commands = suite_commands(config, separate)
    assert len(commands) == count
    for command in commands:
        assert {
            "scene_renderer:weights:=my.safetensors",
            "grasp_evaluator:gripper:=panda",
            "scene_renderer:threads:=1",
            "grasp_server:max_candidates:=64",
        } <= set(command.arguments)


def test_weights_that_nobody_named_are_not_passed_on():
    (command,) = suite_commands(PlannerConfig(), separate=False)
    assert not [word for word in command.arguments if "weights" in word]


def test_made_up_images_stay_in_a_domain_of_this_machine(monkeypatch):
    seen = []

    def note(*_):
        names = ("ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE")
        seen.append(tuple(os.environ[name] for name in names))
        return {"n": len(seen)}

    monkeypatch.setattr(service_latency, "asked", note)
    monkeypatch.delenv("ROS_DOMAIN_ID")
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    found = by_service([], 1, PlannerConfig())
    assert found == {"service_composed": {"n": 1}, "service_separate": {"n": 2}}
    assert seen[0] == seen[1]
    assert 1 <= int(seen[0][0]) <= 100 and seen[0][1] == "LOCALHOST"


@pytest.fixture
def waiting(monkeypatch):
    """A probe that waits until the suite no longer runs; yields its start."""
    begun = threading.Event()

    def measure(shots, requests, start_timeout, is_running, after, pause):
        begun.set()
        deadline = time.monotonic() + 20
        while is_running():
            assert time.monotonic() < deadline
            time.sleep(0.01)
        raise NoAnswerError("the suite has ended")

    monkeypatch.setattr(service_probe, "measure", measure)
    return begun


def test_a_suite_that_dies_ends_the_measurement_and_the_other_processes(waiting):
    commands = [
        Command("dies", (sys.executable, "-c", "raise SystemExit(3)")),
        Command("sleeps", SLEEPER),
    ]
    with pytest.raises(NoAnswerError, match="has ended"):
        asked(commands, [], 1)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_no_process_behind(waiting, monkeypatch, number):
    made = []

    class Noted(service_latency.Supervisor):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            made.append(self)

    def send():
        assert waiting.wait(20)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(service_latency, "Supervisor", Noted)
    sender = threading.Thread(target=send)
    sender.start()
    with pytest.raises(NoAnswerError, match="has ended"):
        asked([Command("sleeps", SLEEPER)], [], 1)
    sender.join()
    (supervisor,) = made
    assert all(p.poll() is not None for p in supervisor.processes.values())
