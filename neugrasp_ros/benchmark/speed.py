# SPDX-License-Identifier: Apache-2.0
"""How long a decision takes, stage by stage, beside the paper's renderer."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neugrasp_ros.benchmark.shots import Shot
from neugrasp_ros.pipeline import GraspPlanner

STAGES = (
    "fusion", "encoding", "rendering", "sampling", "local_rendering", "quality"
)  # fmt: skip
MATMUL = 512  # rows of the fixed product that tells how fast the machine is now
REGION = 0.1  # [m], half the edge of the region that a re-query asks for


def matmul_ms() -> float:
    """Return the least time of a fixed matrix product in [ms]."""
    a = torch.ones(MATMUL, MATMUL)
    spent = []
    for _ in range(20):
        start = time.perf_counter()
        torch.mm(a, a)
        spent.append(time.perf_counter() - start)
    return 1e3 * min(spent)


def peak_memory_mb(process: int | str = "self") -> float:
    """Return the greatest resident memory of a process so far in [MB]."""
    return _memory_mb("VmHWM", process)


def resident_mb(process: int | str = "self") -> float:
    """Return the resident memory of a process now in [MB]."""
    return _memory_mb("VmRSS", process)


def _memory_mb(field: str, process: int | str) -> float:
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    found = next(line for line in lines if line.startswith(field))
    return int(found.split()[1]) / 1024


def time_decision(
    planner: GraspPlanner, shot: Shot, revision: int, max_candidates: int = 0
) -> dict[str, float]:
    """Time one decision from depth image to ranked grasps, and a re-query of it.

    Returns:
        Milliseconds of each of ``STAGES``, ``total`` and ``requery``, and of processor
        time for the whole, ``cpu``; ``queries`` of the field; ``candidates`` scored;
        ``cubes``.
    """
    processor = time.process_time()
    start = time.perf_counter()
    volume = shot.fused(planner.resolution)
    fused = time.perf_counter()
    decision = planner.decide(volume, revision, max_candidates=max_candidates)
    total = time.perf_counter() - start
    processor = time.process_time() - processor
    row = {name: 1e3 * decision.seconds.get(name, 0.0) for name in STAGES}
    row["fusion"] = 1e3 * (fused - start)
    scene = planner.encode(volume, revision)
    start = time.perf_counter()
    if len(decision.grasps):
        middle = decision.grasps.poses[0, :3, 3]
        planner.decide(
            volume,
            revision,
            roi=(middle - REGION, middle + REGION),
            max_candidates=len(decision.grasps),
        )
    row["requery"] = 1e3 * (time.perf_counter() - start)
    row["total"], row["cpu"] = 1e3 * total, 1e3 * processor
    row["queries"] = scene.queries
    row["candidates"] = decision.sampled
    row["cubes"] = len(scene.corners)
    return row


def best_of(
    planner: GraspPlanner,
    shots: Sequence[Shot],
    *,
    repeats: int = 3,
    max_candidates: int = 0,
) -> list[dict[str, float]]:
    """Time a decision on each shot, the best of several runs each."""
    rows, revision = [], time.time_ns()
    for shot in shots:
        runs = []
        for _ in range(repeats):
            revision += 1
            runs.append(time_decision(planner, shot, revision, max_candidates))
        rows.append(min(runs, key=lambda run: run["total"]))
    return rows


def summary(rows: Sequence[dict[str, float]]) -> dict[str, Any]:
    """Return median and 90th percentile of what ``best_of`` gave."""
    columns = {name: [row[name] for row in rows] for name in rows[0]}
    result: dict[str, Any] = {
        "stages_ms": {
            name: {
                "median": float(np.median(columns[name])),
                "p90": float(np.percentile(columns[name], 90)),
            }
            for name in (*STAGES, "requery")
        },
        "total_ms_median": float(np.median(columns["total"])),
        "total_ms_p90": float(np.percentile(columns["total"], 90)),
        "cpu_ms_median": float(np.median(columns["cpu"])),
        "cpu_ms_p90": float(np.percentile(columns["cpu"], 90)),
        "requery_ms_median": float(np.median(columns["requery"])),
        "scenes": len(rows),
    }
    for name in ("queries", "candidates", "cubes"):
        result[f"{name}_median"] = float(np.median(columns[name]))
    return result


def best_run(planner: GraspPlanner, shots: Sequence[Shot], runs: int) -> dict[str, Any]:
    """Time a decision on each shot, once in each of several runs.

    Returns:
        The ``summary`` of the run with the least median, and every run's median, 90th
        percentile and least time of the fixed matrix product in [ms].
    """
    found = []
    for _ in range(runs):
        product = matmul_ms()
        rows = best_of(planner, shots, repeats=1)
        found.append({**summary(rows), "matmul_512_ms": product})
    kept = {
        f"runs_{name}": [run[name] for run in found]
        for name in ("total_ms_median", "total_ms_p90", "matmul_512_ms")
    }
    best = dict(min(found, key=lambda run: run["total_ms_median"]))
    del best["matmul_512_ms"]  # that of the whole profile has this name
    return best | kept


def against_reference(
    fast: GraspPlanner, shots: Sequence[Shot], n_grasps: int
) -> dict[str, float]:
    """Time the reference and the fast path on the same scenes.

    Encoding counts for the fast path, whose field belongs to rendering, and not for
    the reference. Scoring is compared per grasp.

    Args:
        fast: The fast planner.
        shots: What both see.
        n_grasps: Grasps that the reference scores in each.

    Returns:
        Milliseconds, queries and ratios.
    """
    slow = GraspPlanner(replace(fast.config, renderer="reference"), fast.gripper)
    spent: dict[str, list[float]] = {}
    for shot in shots:
        quick = best_of(fast, [shot])[0]
        volume = shot.fused(fast.resolution)
        slow.timings.clear()
        scene = slow.encode(volume, 1)
        grasps = slow.sample(scene)
        if not len(grasps) or not quick["candidates"]:
            continue
        rows = np.arange(min(n_grasps, len(grasps)))
        slow.evaluate(scene, grasps.take(rows))
        milli = {name: 1e3 * value for name, value in slow.timings.items()}
        scene_ms = milli["rendering"] + milli["sampling"]
        scoring = (milli["local_rendering"] + milli["quality"]) / len(rows)
        fast_scene = quick["encoding"] + quick["rendering"] + quick["sampling"]
        fast_scoring = quick["local_rendering"] + quick["quality"]
        for name, value in (
            ("reference_rendering_ms", scene_ms),
            ("reference_scoring_ms_per_grasp", scoring),
            ("fast_rendering_ms", fast_scene),
            ("fast_scoring_ms_per_grasp", fast_scoring / quick["candidates"]),
        ):
            spent.setdefault(name, []).append(value)
    medians = {name: float(np.median(values)) for name, values in spent.items()}
    pairs = ("rendering", "_ms"), ("scoring", "_ms_per_grasp")
    for name, unit in pairs if medians else ():
        slow_ms = medians[f"reference_{name}{unit}"]
        medians[f"speedup_{name}"] = slow_ms / medians[f"fast_{name}{unit}"]
    return medians
