# SPDX-License-Identifier: Apache-2.0
"""What every process of the suite does first, and how it spins and ends."""

import ctypes
import gc
import logging
import os
import platform
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import rclpy
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.signals import SignalHandlerOptions

from neugrasp_ros.errors import ConfigError, NeuGraspError
from neugrasp_ros.nodes.executor import DRAIN_TIME, PatientExecutor
from neugrasp_ros.resources import config_dir

PROFILE_VARIABLES = (
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_DEFAULT_PROFILES_FILE",
)
NO_TUNING = "NEUGRASP_NO_TUNING"
MALLOPT = {  # glibc: option -> value; keeps megabyte messages off mmap
    -3: 32 << 20,  # M_MMAP_THRESHOLD
    -1: 256 << 20,  # M_TRIM_THRESHOLD
    -2: 64 << 20,  # M_TOP_PAD
    -8: 2,  # M_ARENA_MAX: memory that one thread frees serves the others
}
SWITCH_INTERVAL = 0.0005  # [s] that a thread may run while another wants to
SPIN_PERIOD = 0.1  # [s] between two looks whether to stop
TRIM_PERIOD = 10.0  # [s] after which the allocator gives back what is free
START_ERROR = 1  # exit code of a node that cannot start


def prepare() -> tuple[str, ...]:
    """Tune DDS and the allocator for megabyte messages; call before ``rclpy.init``.

    Nothing that the user has set is overridden, and ``NEUGRASP_NO_TUNING=1`` turns all
    of it off.

    Returns:
        What was set, for a log line.
    """
    if _is_untuned():
        return ()
    done = ["thread switches"]
    sys.setswitchinterval(SWITCH_INTERVAL)  # a request returns from kernels often
    if _uses_fastrtps() and not any(name in os.environ for name in PROFILE_VARIABLES):
        os.environ[PROFILE_VARIABLES[0]] = str(config_dir() / "fastdds.xml")
        done.append("Fast DDS profile")
    if platform.libc_ver()[0] == "glibc":
        libc = ctypes.CDLL(None)
        for name, value in MALLOPT.items():
            libc.mallopt(name, value)
        done.append("mallopt")
    if "AMENT_PREFIX_PATH" not in os.environ:
        os.environ["AMENT_PREFIX_PATH"] = sys.prefix
        done.append("AMENT_PREFIX_PATH")
    return tuple(done)


def give_back_memory() -> None:
    """Let the allocator return free memory to the system; a few milliseconds.

    Threads that take turns at the same work otherwise leave ever more of it scattered.
    """
    if platform.libc_ver()[0] == "glibc" and not _is_untuned():
        ctypes.CDLL(None).malloc_trim(0)


def _is_untuned() -> bool:
    return os.environ.get(NO_TUNING, "") not in ("", "0")


def _uses_fastrtps() -> bool:
    return "fastrtps" in os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")


class _RosHandler(logging.Handler):
    """Hands the library's log records to ROS."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._logger = get_logger(name)

    def emit(self, record: logging.LogRecord) -> None:
        line = self.format(record)
        # one call per level: rclpy binds a level to the place it is called from
        if record.levelno >= logging.ERROR:
            self._logger.error(line)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(line)
        elif record.levelno >= logging.INFO:
            self._logger.info(line)
        else:
            self._logger.debug(line)


def spare_what_is_loaded() -> None:
    """Keep what is there now out of the garbage collector's rounds, for good.

    Messages are many small objects, and with torch loaded a round over everything
    takes 0.2 s, in the middle of an answer.
    """
    gc.collect()
    gc.freeze()


def forward_library_logs(name: str) -> None:
    """Send the log records of our packages to the ROS logger ``name``."""
    for package in ("neugrasp_ros", "sim_bridge"):
        logger = logging.getLogger(package)
        logger.handlers = [_RosHandler(name)]
        logger.setLevel(logging.INFO)
        logger.propagate = False


@contextmanager
def ros(
    name: str,
    args: list[str] | None,
    signals: SignalHandlerOptions = SignalHandlerOptions.ALL,
) -> Iterator[None]:
    """Bring ROS up around a block, and down whatever ends it.

    Args:
        name: Name for log lines of the process.
        args: Command line without the program, with ``--ros-args``.
        signals: Which signals rclpy may answer by taking ROS down at once.

    Raises:
        ConfigError: If ROS cannot read the command line.
    """
    prepare()
    try:
        rclpy.init(args=args, signal_handler_options=signals)
    except RuntimeError as error:  # RCLError and its kin
        raise ConfigError(str(error).split(", at /")[0]) from error
    forward_library_logs(name)
    try:
        yield
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()


def run(
    name: str,
    start: Callable[[Executor], Callable[[], None]],
    args: list[str] | None,
    threads: int = 4,
) -> int:
    """Run nodes until shutdown and return the exit code of the process.

    On SIGINT and SIGTERM the nodes end before ROS does, so that none of them publishes
    into a context that is gone.

    Args:
        name: Name for log lines of the process.
        start: Builds the nodes, adds them to the executor, and returns what has to be
            called at the end.
        args: Command line without the program, with ``--ros-args``.
        threads: Callbacks that may run at once.

    Returns:
        0, or 1 where a node could not start; the reason is in the log.
    """
    try:
        return _run(name, start, args, threads)
    except ConfigError as error:
        get_logger(name).fatal(f"cannot start: {error}")
        return START_ERROR


def _run(
    name: str,
    start: Callable[[Executor], Callable[[], None]],
    args: list[str] | None,
    threads: int,
) -> int:
    with ros(name, args, SignalHandlerOptions.NO):
        executor = PatientExecutor(threads)
        try:
            stop = start(executor)
            spare_what_is_loaded()
        except NeuGraspError as error:
            get_logger(name).fatal(f"cannot start: {error}")
            return START_ERROR
        try:
            _spin_until_signal(executor)
        finally:
            executor.drain()
            stop()
            executor.shutdown(DRAIN_TIME)
    return 0


def _spin_until_signal(executor: Executor) -> None:
    """Spin until SIGINT, SIGTERM or the end of ROS; a second signal is the system's."""
    stopping = threading.Event()
    before = {
        number: signal.signal(number, lambda *_: stopping.set())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        trimmed = time.monotonic()
        while executor.context.ok() and not stopping.is_set():
            executor.spin_once(timeout_sec=SPIN_PERIOD)
            if time.monotonic() - trimmed > TRIM_PERIOD:
                give_back_memory()
                trimmed = time.monotonic()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class SpinThread:
    """Spins an executor in a thread until told to stop.

    ``Executor.shutdown`` pulls handles from under a spin that still runs, so the spin
    is ended first.

    Args:
        executor: The executor; shut down by ``stop``.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="spin", daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while not self._stopped.is_set():
            try:
                self._executor.spin_once(timeout_sec=SPIN_PERIOD)
            except ExternalShutdownException:
                return

    def stop(self) -> None:
        """End the spin, then the executor."""
        self._stopped.set()
        self._executor.wake()
        self._thread.join()
        self._executor.shutdown(DRAIN_TIME)
