# SPDX-License-Identifier: Apache-2.0
"""The demonstration: a client against a running suite, a table, and a picture."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from threading import Event
from typing import Any

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.nodes.demo_client import (
    START_TIMEOUT,
    DemoClient,
    DemoError,
    DemoResult,
    DemoScene,
    demo_node,
    stage_milliseconds,
)
from neugrasp_ros.nodes.robot_demo import RobotDemoClient
from neugrasp_ros.pictures.decision import draw_decision
from neugrasp_ros.pictures.film import write_film, write_strip

GRIPPER = "robotiq_2f85"
HEADER = (
    f"{'try':>3} {'quality':>7} {'width':>8}  {'result':<28} milliseconds per stage"
)


def run_demo(
    scene: DemoScene,
    *,
    picture: Path,
    robot: bool,
    say: Callable[[str], None],
    stopping: Event,
) -> dict[str, Any]:
    """Clear a table, tell the attempts as they come, draw the first decision.

    Args:
        scene: What is on the table, and what is asked for.
        picture: Where the picture goes.
        robot: A whole robot carries the grasps out; a film of it goes beside the
            picture.
        say: Shows a line to the user.
        stopping: Set to end the demonstration early.

    Returns:
        JSON-able: ``lifted``, ``objects``, ``attempts``, ``milliseconds``, ``seed``,
        ``scene``, and ``error`` where the demonstration broke off.
    """
    result, error = DemoResult(objects=0), ""
    with demo_node(RobotDemoClient if robot else DemoClient, stopping) as client:
        try:
            client.wait_for_suite(START_TIMEOUT)
            say(HEADER)
            result = client.clear_table(scene, lambda r: say(_last_line(r)))
        except DemoError as problem:
            error = str(problem)
    for report in result.reports:
        if report.code:
            say(f"no grasp (code {report.code}): {report.message}")
    if result.decision is not None:
        draw_decision(
            result.decision,
            result.attempts,
            load_gripper(GRIPPER),
            picture,
            f"neugrasp: {scene.kind}, seed {scene.seed}: lifted {result.lifted} of "
            f"{result.objects} in {len(result.attempts)} attempts",
        )
        say(f"picture: {picture}")
    record: dict[str, Any] = {}
    if isinstance(client, RobotDemoClient):
        record["largest_contact_n"] = client.largest_contact
        if client.shots:
            film, strip = picture.with_suffix(".gif"), _beside(picture, "strip")
            write_film(client.shots, film)
            write_strip(client.shots, strip)
            say(f"film: {film}\nstrip: {strip}")
    return {
        "scene": scene.kind,
        "seed": scene.seed,
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
