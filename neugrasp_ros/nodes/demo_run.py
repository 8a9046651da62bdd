# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a client against a running suite, a table, and a picture."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rclpy.executors import SingleThreadedExecutor

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.nodes.demo_client import (
    DemoClient,
    DemoError,
    DemoResult,
    stage_milliseconds,
)
from neugrasp_ros.nodes.robot_demo import RobotDemoClient
from neugrasp_ros.nodes.runtime import ros
from neugrasp_ros.pictures.decision import draw_decision
from neugrasp_ros.pictures.film import write_film, write_strip

GRIPPER = "robotiq_2f85"
START_TIMEOUT = 90.0  # [s]
HEADER = (
    f"{'try':>3} {'quality':>7} {'width':>8}  {'result':<28} milliseconds per stage"
)


def run_demo(
    *,
    kind: str,
    seed: int,
    n_objects: int,
    affordance: str,
    picture: Path,
    robot: bool,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Clear a table, tell the attempts as they come, draw the first decision.

    Args:
        kind: Scene kind.
        seed: Seed of scene and sampler.
        n_objects: Objects asked for.
        affordance: Query of every detection.
        picture: Where the picture goes.
        robot: A whole robot carries the grasps out; a film of it goes beside the
            picture.
        say: Shows a line to the user.

    Returns:
        JSON-able: ``lifted``, ``objects``, ``attempts``, ``milliseconds``, ``seed``,
        ``scene``, and ``error`` where the demonstration broke off.
    """
    result, error = DemoResult(objects=0), ""
    with ros("demo", None):
        executor = SingleThreadedExecutor()
        kind_of_client = RobotDemoClient if robot else DemoClient
        client = kind_of_client(lambda seconds: executor.spin_once(timeout_sec=seconds))
        executor.add_node(client)
        try:
            client.wait_for_suite(START_TIMEOUT)
            say(HEADER)
            result = client.clear_table(
                kind, seed, n_objects, lambda r: say(_last_line(r)), affordance
            )
        except DemoError as problem:
            error = str(problem)
        finally:
            client.destroy_node()
            executor.shutdown()
    for report in result.reports:
        if report.code:
            say(f"no grasp (code {report.code}): {report.message}")
    if result.decision is not None:
        draw_decision(
            result.decision,
            result.attempts,
            load_gripper(GRIPPER),
            picture,
            f"neugrasp: {kind}, seed {seed}: lifted {result.lifted} of "
            f"{result.objects} in {len(result.attempts)} attempts",
        )
        say(f"picture: {picture}")
    record: dict[str, Any] = {}
    if isinstance(client, RobotDemoClient):
        record["largest_contact_n"] = client.largest_contact
        if client.frames:
            film, strip = picture.with_suffix(".gif"), _beside(picture, "strip")
            write_film(client.frames, film)
            write_strip(client.frames, strip)
            say(f"film: {film}\nstrip: {strip}")
    return {
        "scene": kind,
        "seed": seed,
        "objects": result.objects,
        "lifted": result.lifted,
        "attempts": [asdict(attempt) for attempt in result.attempts],
        "milliseconds": [stage_milliseconds(report) for report in result.reports],
        **record,
        **({"error": error} if error else {}),
    }


def _beside(picture: Path, name: str) -> Path:
    return picture.with_name(f"{picture.stem}_{name}.png")


def _last_line(result: DemoResult) -> str:
    attempt, stages = result.attempts[-1], stage_milliseconds(result.reports[-1])
    times = ", ".join(f"{name} {value:.0f}" for name, value in stages.items())
    return (
        f"{len(result.attempts):>3} {attempt.quality:7.2f} "
        f"{1e3 * attempt.width:5.0f} mm  {attempt.result:<28} {times}"
    )
