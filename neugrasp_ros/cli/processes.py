# SPDX-License-Identifier: Apache-2.0
"""Processes under supervision: prefixed output, forwarded signals, an exit code."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

POLL = 0.1  # [s]
PATIENCE = 10.0  # [s] between a polite signal and a stronger one
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)


@dataclass(frozen=True, slots=True)
class Command:
    """A process to start: its name for the log, its command line."""

    name: str
    arguments: tuple[str, ...]


def keep_to_this_machine() -> str:
    """Choose a random domain on this machine, unless the environment says which.

    Returns:
        The domain.
    """
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(1, 101)))


def python_main(module: str, arguments: Sequence[str]) -> tuple[str, ...]:
    """Return the command line that runs ``module.main`` with this interpreter.

    Until the module catches SIGINT itself, it ends the process without a word, also in
    the seconds of its imports.
    """
    quiet = "signal.signal(signal.SIGINT, signal.SIG_DFL)"
    code = f"import signal, sys; {quiet}; from {module} import main; sys.exit(main())"
    return (sys.executable, "-c", code, *arguments)


class Supervisor:
    """Runs processes until one ends or all are told to.

    Args:
        commands: What to start.
        write: Takes each line of output, with its prefix.
        stopping: Set by whoever wants all processes to end, even before they run.
    """

    def __init__(
        self,
        commands: Sequence[Command],
        write: Callable[[str], None] = lambda line: print(line, flush=True),
        stopping: threading.Event | None = None,
    ) -> None:
        self._write = write
        self._stopping = stopping or threading.Event()
        environment = os.environ | {"PYTHONUNBUFFERED": "1"}
        self.processes: dict[str, subprocess.Popen[str]] = {}
        self._readers = []
        for command in commands:
            process = subprocess.Popen(
                command.arguments,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                env=environment,
                start_new_session=True,  # the terminal's Ctrl-C comes through us
            )
            self.processes[command.name] = process
            reader = threading.Thread(
                target=self._read, args=(command.name, process), daemon=True
            )
            reader.start()
            self._readers.append(reader)

    def _read(self, name: str, process: "subprocess.Popen[str]") -> None:
        if process.stdout is not None:
            for line in process.stdout:
                self._write(f"[{name}] {line.rstrip()}")

    def request_stop(self) -> None:
        """Make ``wait`` return."""
        self._stopping.set()

    def wait(self) -> int:
        """Wait until asked to stop or a process ends; then end all.

        Returns:
            0 if asked to stop and all ended well; else the exit code of the first
            process that ended by itself, or 1 where that was 0.
        """
        code = 0
        while not self._stopping.is_set():
            ended = {n: p.poll() for n, p in self.processes.items()}
            gone = {n: c for n, c in ended.items() if c is not None}
            if gone:
                name, value = next(iter(gone.items()))
                self._write(f"[{name}] ended with exit code {value}; stopping all")
                code = value if value > 0 else 1
                break
            self._stopping.wait(POLL)
        self.stop()
        return code

    def stop(self) -> None:
        """End all processes, politely first."""
        for number in SIGNALS:
            alive = [p for p in self.processes.values() if p.poll() is None]
            for process in alive:
                process.send_signal(number)
            deadline = time.monotonic() + PATIENCE
            for process in alive:
                try:
                    process.wait(max(deadline - time.monotonic(), 0.01))
                except subprocess.TimeoutExpired:
                    continue
        for reader in self._readers:
            reader.join(timeout=1.0)
        for process in self.processes.values():
            if process.stdout is not None:
                process.stdout.close()


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Catch what asks a command to end while the block runs: Ctrl-C, a closed terminal.

    Start processes within the block: a signal that comes between two of them would
    leave those that run without anybody to end them.

    Yields:
        The event that a signal sets.
    """
    stopping = threading.Event()
    before = {
        number: signal.signal(number, lambda *_: stopping.set())
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield stopping
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
