# SPDX-License-Identifier: Apache-2.0
"""What rounds of the whole robot come to: rates, reasons, forces, limits, times."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp_ros.benchmark.metrics import bootstrap_ratio, wilson_interval
from neugrasp_ros.errors import ConfigError

Record = Mapping[str, Any]

LARGEST_FORCE = 20.0  # [N] that robot and furniture may exchange
LIMIT_KEYS = ("position", "velocity", "acceleration", "jerk")


def round_path(folder: Path, index: int) -> Path:
    """Return the file of one round."""
    return folder / f"round_{index:03d}.json"


def keep_round(folder: Path, record: Record) -> None:
    """Write a round, whole or not at all."""
    folder.mkdir(parents=True, exist_ok=True)
    path = round_path(folder, int(record["index"]))
    partial = path.with_suffix(".part")
    partial.write_text(json.dumps(record, indent=1) + "\n")
    partial.replace(path)


def load_rounds(
    folder: Path, count: int, seed: int, weights_sha256: str
) -> list[dict[str, Any]]:
    """Read the rounds of a folder, by number.

    Args:
        folder: Where they are kept.
        count: Rounds from this number on are left out.
        seed: Of the run that they must belong to.
        weights_sha256: Of the weights that must have chosen the grasps.

    Raises:
        ConfigError: If one is damaged, or of another seed or other weights.
    """
    rounds = []
    for path in sorted(folder.glob("round_*.json")):
        try:
            record = json.loads(path.read_text())
        except ValueError as error:
            raise ConfigError(f"{path}: not JSON ({error})") from error
        asked = {"seed": seed + record["index"], "weights_sha256": weights_sha256}
        for name, value in asked.items():
            if record.get(name) != value:
                raise ConfigError(
                    f"{path}: {name} is {record.get(name)}, this run's is {value}: "
                    "keep its rounds in another folder"
                )
        rounds.append(record)
    return [record for record in rounds if record["index"] < count]


def summarize_rounds(rounds: Sequence[Record]) -> dict[str, Any]:
    """Pool rounds.

    Args:
        rounds: Records of ``RobotRound``.

    Returns:
        Executed attempts (an arm moved) with what held and what came into a box, each
        with Wilson's 95 % interval in percent; objects with a bootstrap interval over
        rounds; every failure by reason; forces; limits; planning times.
    """
    attempts = [a for r in rounds for a in r["attempts"]]
    executed = [a for a in attempts if a["executed"]]
    cleared = np.array([len(r["cleared"]) for r in rounds], dtype=np.float64)
    objects = np.array([len(r["objects"]) for r in rounds], dtype=np.float64)
    share = bootstrap_ratio(cleared, objects, np.random.default_rng(0))
    forces = [float(r["largest_contact"]) for r in rounds]
    return {
        "rounds": len(rounds),
        "kinds": dict(Counter(r["kind"] for r in rounds)),
        "ended": dict(Counter(r["ended"] for r in rounds)),
        "asked": len(attempts),
        "executed": len(executed),
        "held": _rate([bool(a["held"]) for a in executed]),
        "in_the_box": _rate([bool(a["cleared"]) for a in executed]),
        "objects": int(objects.sum()),
        "cleared": int(cleared.sum()),
        "cleared_percent": 100.0 * float(cleared.sum() / max(objects.sum(), 1.0)),
        "cleared_ci": [100.0 * bound for bound in share],
        "failures": _reasons(attempts),
        "no_grasp": dict(Counter(s.split()[0] for r in rounds for s in r["skips"])),
        "contact_newton": {
            "median": float(np.median(forces)),
            "largest": max(forces),
            "rounds_above_20": int(sum(force > LARGEST_FORCE for force in forces)),
            "links": dict(Counter(r["contact_link"] or "none" for r in rounds)),
        },
        "limits": {
            **{key: max(float(r["limits"][key]) for r in rounds) for key in LIMIT_KEYS},
            "samples": int(sum(r["limits"]["samples"] for r in rounds)),
        },
        "planning_seconds": _spread([s for a in attempts for s in a["planning"]]),
        "simulated_seconds": float(sum(r["simulated"] for r in rounds)),
        "wall_seconds": float(sum(r["wall"] for r in rounds)),
    }


def by_kind(rounds: Sequence[Record]) -> dict[str, dict[str, Any]]:
    """Return the main figures per furniture set-up."""
    found = {}
    for kind in sorted({str(r["kind"]) for r in rounds}):
        one = summarize_rounds([r for r in rounds if r["kind"] == kind])
        keys = ("rounds", "executed", "held", "objects", "cleared", "failures")
        found[kind] = {key: one[key] for key in keys}
    return found


def _rate(hits: Sequence[bool]) -> dict[str, Any]:
    low, high = wilson_interval(sum(hits), len(hits))
    percent = 100.0 * sum(hits) / len(hits) if hits else None
    return {"count": sum(hits), "percent": percent, "ci": [100 * low, 100 * high]}


def _reasons(attempts: Sequence[Record]) -> dict[str, int]:
    """Return how often attempts failed, by outcome and sentence without numbers."""
    failed = [a for a in attempts if not a["cleared"]]
    return dict(Counter(f"{a['outcome']}: {_general(a['message'])}" for a in failed))


def _general(sentence: str) -> str:
    return "".join("#" if c.isdigit() else c for c in sentence)


def _spread(values: Sequence[float]) -> dict[str, Any]:
    if not values:
        return {"count": 0}
    return {
        "count": len(values),
        "median": float(np.median(values)),
        "p90": float(np.quantile(values, 0.9)),
        "largest": float(max(values)),
    }
