# SPDX-License-Identifier: Apache-2.0
"""``neugrasp detect``: ask a running suite for grasps."""

import argparse
import json
import math

NONE_FOUND = 1
NOT_RUNNING = 2
LONGEST = 1e6  # [s]; more than the waits of the system can take is near 1e9


def add_parser(
    subparsers: "argparse._SubParsersAction[argparse.ArgumentParser]",
) -> None:
    """Add the command and its options."""
    parser = subparsers.add_parser(
        "detect",
        help="ask a running suite for grasps",
        description="Ask a running suite for grasps, like `ros2 service call "
        "/detect_grasps neugrasp_msgs/srv/DetectGrasps`. Exit code 0: at least one "
        "grasp, 1: none (the reason is printed), 2: the suite is not running, still "
        "starting, or did not answer in time, 64: wrong usage.",
    )
    parser.add_argument(
        "--affordance", default="", help="such as pour, cut|stab (any), pour&lift (all)"
    )
    parser.add_argument("--max-grasps", type=count, default=0, metavar="N")
    parser.add_argument("--min-quality", type=float, default=-1.0, metavar="Q")
    parser.add_argument("--min-affordance", type=float, default=-1.0, metavar="P")
    parser.add_argument(
        "--roi", type=float, nargs=6, metavar=("X", "Y", "Z", "DX", "DY", "DZ"),
        help="centre and edges of a box to look in [m]",
    )  # fmt: skip
    parser.add_argument(
        "--roi-frame", default="", help="its frame; default that of the answer"
    )
    parser.add_argument("--frame", default="", help="frame of the answer")
    parser.add_argument(
        "--arm", action="append", default=[], help="planning group; may come twice"
    )
    parser.add_argument(
        "--scene", default="fresh", choices=("current", "fresh", "reset")
    )
    parser.add_argument("--seed", type=count, default=0)
    parser.add_argument("--timeout", type=seconds, default=30.0, metavar="SECONDS")
    parser.add_argument("--ns", default="", metavar="/NAME", help="namespace")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def count(text: str) -> int:
    """Read a whole number that a message can hold."""
    value = int(text)
    if not 0 <= value < 2**32:
        raise argparse.ArgumentTypeError(f"expected 0 to 2^32 - 1, got {value}")
    return value


def seconds(text: str) -> float:
    """Read a time to wait."""
    value = float(text)
    if not (math.isfinite(value) and 0 < value <= LONGEST):
        raise argparse.ArgumentTypeError(
            f"expected seconds above 0, at most {LONGEST:.0f}, got {text}"
        )
    return value


def run(args: argparse.Namespace) -> int:
    """Ask, print the answer, and return the exit code."""
    from neugrasp_ros.nodes.client import NoAnswerError, SuiteClient
    from neugrasp_ros.nodes.outcomes import Code

    try:
        with SuiteClient(args.ns) as client:
            answer = client.detect(
                timeout=args.timeout,
                affordance=args.affordance,
                max_grasps=args.max_grasps,
                min_quality=args.min_quality,
                min_affordance=args.min_affordance,
                roi=args.roi,
                roi_frame=args.roi_frame,
                frame_id=args.frame,
                arms=args.arm,
                scene=("current", "fresh", "reset").index(args.scene),
                seed=args.seed,
            )
    except NoAnswerError as error:
        print(json.dumps({"error": str(error)}) if args.json else str(error))
        return NOT_RUNNING
    print(json.dumps(answer, indent=1) if args.json else _table(answer))
    if answer["grasps"]:
        return 0
    late = (Code.NOT_ACTIVE.name, Code.TIMEOUT.name)
    return NOT_RUNNING if answer["code"] in late else NONE_FOUND


def _table(answer: dict) -> str:
    """Return an answer for people."""
    counts = ", ".join(f"{k} {v}" for k, v in answer["counts"].items())
    lines = [f"{answer['code']}: {answer['message']}", counts]
    if answer["grasps"]:
        lines.append(f"frame {answer['frame_id']}, tool frame {answer['tcp_frame']}")
        lines.append(
            "  id     quality  width[mm]  x      y      z      arm"
            + ("             good for" if answer["affordance_labels"] else "")
        )
    for grasp in answer["grasps"]:
        x, y, z = grasp["position"]
        lines.append(
            f"  {grasp['id']:<6} {grasp['quality']:7.3f}  {1e3 * grasp['width']:9.1f}  "
            f"{x:6.3f} {y:6.3f} {z:6.3f} {grasp['arm']:<15} "
            f"{_served(grasp, answer['affordance_labels'])}"
        )
    spent = {k: v for k, v in answer["seconds"].items() if v > 0}
    lines.append(", ".join(f"{k} {1e3 * v:.0f} ms" for k, v in spent.items()))
    return "\n".join(line.rstrip() for line in lines)


def _served(grasp: dict, labels: list[str]) -> str:
    """Return what a grasp is good for, with probabilities."""
    from neugrasp_ros.grasp.queries import good_for

    scores = grasp["affordance_scores"]
    if len(scores) != len(labels) or not labels:
        return ""
    by_name = dict(zip(labels, scores, strict=True))
    known = [f"{name} {by_name[name]:.2f}" for name in good_for(scores, labels)]
    return ", ".join(known) or "not known"
