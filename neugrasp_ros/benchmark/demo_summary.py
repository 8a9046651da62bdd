# SPDX-License-Identifier: Apache-2.0
"""Many demonstrations as one figure: what ``neugrasp demo --json`` wrote, pooled."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp_ros.benchmark.metrics import bootstrap_ratio, wilson_interval
from neugrasp_ros.errors import ConfigError

NEEDED = {"seed", "objects", "lifted", "attempts", "weights_sha256", "commit"}


def load_demos(folder: str | Path) -> list[dict[str, Any]]:
    """Read the demonstrations of a folder, by seed.

    Raises:
        ConfigError: If there is none, one is damaged, or they are of different weights.
    """
    demos = []
    for path in sorted(Path(folder).glob("*.json")):
        try:
            demo = json.loads(path.read_text())
        except ValueError as error:
            raise ConfigError(f"{path}: not JSON ({error})") from error
        if isinstance(demo, dict) and set(demo) >= NEEDED:
            demos.append(demo)
    if not demos:
        raise ConfigError(f"{folder}: holds no result of `neugrasp demo --json`")
    weights = {demo["weights_sha256"] for demo in demos}
    if len(weights) > 1:
        raise ConfigError(f"{folder}: demonstrations of {len(weights)} weights files")
    return sorted(demos, key=lambda demo: int(demo["seed"]))


def summarize_demos(demos: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Pool demonstrations.

    Args:
        demos: What ``load_demos`` returns.

    Returns:
        Attempts and successes with Wilson's 95 % interval in percent, lifted objects
        with a bootstrap interval over demonstrations, results by name, and the median
        and 90th percentile of each stage's time in [ms].
    """
    lifted = np.array([demo["lifted"] for demo in demos], dtype=np.float64)
    objects = np.array([demo["objects"] for demo in demos], dtype=np.float64)
    attempts = [attempt for demo in demos for attempt in demo["attempts"]]
    successes = sum(bool(attempt["success"]) for attempt in attempts)
    held = wilson_interval(successes, len(attempts))
    cleared = bootstrap_ratio(lifted, objects, np.random.default_rng(0))
    return {
        "seeds": [demo["seed"] for demo in demos],
        "demos_with_a_lift": int((lifted > 0).sum()),
        "attempts": len(attempts),
        "successes": successes,
        "success_percent": 100.0 * successes / max(len(attempts), 1),
        "success_ci": [100.0 * bound for bound in held],
        "objects": int(objects.sum()),
        "lifted": int(lifted.sum()),
        "lifted_percent": 100.0 * lifted.sum() / max(objects.sum(), 1.0),
        "lifted_ci": [100.0 * bound for bound in cleared],
        "results": dict(Counter(attempt["result"] for attempt in attempts)),
        "milliseconds": _stage_times(demos),
        "weights_sha256": demos[0]["weights_sha256"],
        "commit": ", ".join(sorted({demo["commit"] for demo in demos})),
    }


def _stage_times(demos: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    stages: dict[str, list[float]] = {}
    for demo in demos:
        for answer in demo.get("milliseconds", []):
            for name, value in answer.items():
                stages.setdefault(name, []).append(float(value))
    return {
        name: {
            "median": float(np.median(values)),
            "p90": float(np.quantile(values, 0.9)),
        }
        for name, values in stages.items()
    }
