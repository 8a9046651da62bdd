# SPDX-License-Identifier: Apache-2.0
"""How much later than the library the service answers, composed and separate."""

import threading
from collections.abc import Callable, Mapping, Sequence
from subprocess import Popen
from typing import Any

from neugrasp_ros.cli.processes import (
    Command,
    Supervisor,
    keep_to_this_machine,
    python_main,
    stop_on_signals,
)
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.nodes.table import ros_arguments, suite

START_TIMEOUT = 900.0  # [s], with all kernels to compile beside other work
PLANNER_NODES = ("scene_renderer", "grasp_evaluator")

Watch = Callable[[Mapping[str, "Popen[str]"], int], None]
"""Told the suite's processes by their names, and how many answers have come."""


def by_service(
    shots: Sequence[Any], requests: int, config: PlannerConfig
) -> dict[str, Any]:
    """Run the suite in one process, then in several, and ask it about images.

    Made-up images are no robot's business: unless the environment says which, the suite
    gets a random domain on this machine alone.

    Args:
        shots: Scenes of one cube, of ``benchmark.shots``.
        requests: Answers that count, of either.
        config: Of the suite's planner.

    Returns:
        ``service_composed`` and ``service_separate``, each as of
        ``nodes.service_probe.figures``.

    Raises:
        NoAnswerError: If the suite does not come up, ends or stops answering.
    """
    keep_to_this_machine()
    return {
        name: asked(suite_commands(config, separate), shots, requests)
        for name, separate in (("service_composed", False), ("service_separate", True))
    }


def suite_commands(config: PlannerConfig, separate: bool) -> list[Command]:
    """Return the processes of a suite whose planner is configured like that."""
    values = {"threads": str(config.threads), "gripper": config.gripper}
    if config.weights:
        values["weights"] = config.weights
    parameters = [
        f"{node}:{name}:={value}"
        for node in PLANNER_NODES
        for name, value in values.items()
    ]
    parameters.append(f"grasp_server:max_candidates:={config.max_candidates}")
    return [
        Command(
            spec.name,
            python_main(spec.module, ros_arguments(spec, parameters=parameters)),
        )
        for spec in suite(sim=False, separate=separate)
    ]


def asked(
    commands: Sequence[Command],
    shots: Sequence[Any],
    requests: int,
    after: Watch = lambda *_: None,
    pause: float | None = None,
) -> dict[str, Any]:
    """Run a suite while it is asked; a signal, or the end of one process, ends all.

    Args:
        commands: The suite.
        shots: Scenes of one cube.
        requests: Answers that count.
        after: Called after each of them.
        pause: Between an answer and the next question in [s]; default the probe's.

    Returns:
        As of ``nodes.service_probe.figures``.

    Raises:
        NoAnswerError: If the suite does not come up, ends or stops answering.
    """
    from neugrasp_ros.nodes.service_probe import PAUSE, measure

    with stop_on_signals() as stopping:
        supervisor = Supervisor(commands, stopping=stopping)
        watcher = threading.Thread(target=supervisor.wait, daemon=True)
        watcher.start()

        def is_running() -> bool:
            codes = [process.poll() for process in supervisor.processes.values()]
            return not stopping.is_set() and all(code is None for code in codes)

        try:
            return measure(
                shots, requests, START_TIMEOUT, is_running,
                lambda answers: after(supervisor.processes, answers),
                PAUSE if pause is None else pause,
            )  # fmt: skip
        finally:
            supervisor.request_stop()
            watcher.join()
