# SPDX-License-Identifier: Apache-2.0
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from neugrasp_ros.cli.processes import (
    Command,
    Supervisor,
    python_main,
    stop_on_signals,
)

IGNORES_INTERRUPT = """
import signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
print("deaf", flush=True)
time.sleep(60)
"""


def python(name: str, code: str) -> Command:
    return Command(name, (sys.executable, "-c", code))


def wait_for(condition, seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_output_is_prefixed_and_an_end_by_itself_ends_all():
    lines: list[str] = []
    supervisor = Supervisor(
        [
            python("one", "print('hello'); import sys; sys.exit(3)"),
            python("two", "import time; time.sleep(60)"),
        ],
        lines.append,
    )
    assert supervisor.wait() == 3
    assert "[one] hello" in lines
    assert "[one] ended with exit code 3; stopping all" in lines
    assert all(p.poll() is not None for p in supervisor.processes.values())


def test_an_early_good_end_is_no_success():
    assert Supervisor([python("one", "pass")], lambda _: None).wait() == 1


def test_asked_to_stop_it_returns_zero():
    lines: list[str] = []
    code = "print('up', flush=True); import time; time.sleep(60)"
    supervisor = Supervisor([python("one", code)], lines.append)
    wait_for(lambda: "[one] up" in lines)
    threading.Timer(0.05, supervisor.request_stop).start()
    assert supervisor.wait() == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_that_comes_before_the_processes_ends_them_all(number):
    with stop_on_signals() as stopping:
        os.kill(os.getpid(), number)
        wait_for(stopping.is_set)
        supervisor = Supervisor(
            [python("one", "import time; time.sleep(60)")], lambda _: None, stopping
        )
        assert supervisor.wait() == 0
    assert supervisor.processes["one"].poll() is not None


def test_a_process_that_is_deaf_to_interrupts_is_terminated(monkeypatch):
    monkeypatch.setattr("neugrasp_ros.cli.processes.PATIENCE", 0.3)
    lines: list[str] = []
    supervisor = Supervisor([python("deaf", IGNORES_INTERRUPT)], lines.append)
    wait_for(lambda: "[deaf] deaf" in lines)
    supervisor.request_stop()
    assert supervisor.wait() == 0
    assert supervisor.processes["deaf"].returncode == -15


def test_the_command_line_runs_a_main_and_hands_its_code_on():
    line = python_main("neugrasp_ros.cli.main", ["--nonsense"])
    lines: list[str] = []
    assert Supervisor([Command("cli", line)], lines.append).wait() == 64


def test_an_interrupted_import_ends_without_a_word(tmp_path, monkeypatch):
    slow = "import time\nprint('importing', flush=True)\ntime.sleep(60)\n"
    (tmp_path / "slow_module.py").write_text(slow)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    process = subprocess.Popen(
        python_main("slow_module", ()),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None and process.stdout.readline() == "importing\n"
    process.send_signal(signal.SIGINT)
    said, _ = process.communicate(timeout=30)
    assert (process.returncode, said) == (-signal.SIGINT, "")
