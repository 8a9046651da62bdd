# SPDX-License-Identifier: Apache-2.0
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("neugrasp_msgs")

pytestmark = pytest.mark.ros

SCRIPT = """
import sys
from neugrasp_ros.cli import demo, main
suite = "import os, time; print(os.getpid(), flush=True); time.sleep(600)"
demo.SUITE = (sys.executable, "-c", suite)
sys.exit(main.main(["demo", "--picture", sys.argv[1], *sys.argv[2:]]))
"""  # a suite that never answers, so that the demonstration waits


def wait_for(value, seconds: float = 60.0):
    deadline = time.monotonic() + seconds
    while not (found := value()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(
    ("number", "options"),
    [(signal.SIGINT, ()), (signal.SIGTERM, ("--affordance", "pour"))],
)
def test_a_signal_ends_demo_and_suite_without_a_traceback(tmp_path, number, options):
    log = tmp_path / "demo.log"
    demo = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(tmp_path / "demo.png"), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    suite = int(wait_for(lambda: log.is_file() and log.read_text().strip()))
    wait_for(lambda: "librcl.so" in _maps(demo.pid))
    time.sleep(1.0)  # now it waits for the suite
    demo.send_signal(number)
    said, _ = demo.communicate(timeout=60)
    assert demo.returncode == 130 and said.splitlines()[-1] == "stopped"
    assert "Traceback" not in said
    assert not is_alive(suite)


def test_a_suite_that_ends_by_itself_ends_the_demo(tmp_path):
    script = SCRIPT.replace("time.sleep(600)", "time.sleep(5); raise SystemExit(3)")
    begin = time.monotonic()
    demo = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "demo.png")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    said = demo.stdout.splitlines()[-1]
    assert demo.returncode == 1 and time.monotonic() < begin + 80
    assert said == (
        f"failed: the suite ended with exit code 3, see {tmp_path / 'demo.log'}"
    )


def _maps(pid: int) -> str:
    with open(f"/proc/{pid}/maps") as file:
        return file.read()
