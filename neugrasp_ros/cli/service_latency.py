# SPDX-License-Identifier: Apache-2.0
"""How much later than the library the service answers, composed and separate."""

import os
import threading
from collections.abc import Sequence
from typing import Any

from neugrasp_ros.cli.processes import Command, Supervisor, python_main
from neugrasp_ros.nodes.table import ros_arguments, suite

START_TIMEOUT = 180.0  # [s], with kernels to compile


def by_service(shots: Sequence[Any], requests: int) -> dict[str, Any]:
    """Run the suite in one process, then in several, and ask it about images.

    Args:
        shots: Scenes of one cube, of ``benchmark.shots``.
        requests: Answers that count, of either.

    Returns:
        ``service_composed`` and ``service_separate``, each as of
        ``nodes.service_probe.figures``.

    Raises:
        NoAnswerError: If the suite does not come up or stops answering.
    """
    from neugrasp_ros.nodes.service_probe import measure

    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    found = {}
    for name, separate in (("service_composed", False), ("service_separate", True)):
        commands = [
            Command(spec.name, python_main(spec.module, ros_arguments(spec)))
            for spec in suite(sim=False, separate=separate)
        ]
        supervisor = Supervisor(commands)
        watcher = threading.Thread(target=supervisor.wait, daemon=True)
        watcher.start()
        try:
            found[name] = measure(shots, requests, START_TIMEOUT)
        finally:
            supervisor.request_stop()
            watcher.join()
    return found
