# SPDX-License-Identifier: Apache-2.0
"""How the time of a decision grows: with candidates, threads, table and voxels."""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch

from neugrasp_ros.benchmark.shots import TABLE_TOP, Shot
from neugrasp_ros.benchmark.speed import best_of, peak_memory_mb
from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.pipeline import GraspPlanner
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.network import SceneNetwork

CANDIDATES = (16, 64, 128, 256, 512, 1024)
RESOLUTIONS = (40, 64, 96, 128)
NEAR = 0.5  # [truncation]; a voxel this near to a surface shows it
# A candidate this near to an object's origin, seen from above, is its [m].
BESIDE = 0.06
LEAST_VOXELS = 12  # of an object that is in view
ABOVE_TABLE = 0.01  # [m]


def by_candidates(planner: GraspPlanner, shots: Sequence[Shot]) -> dict[str, Any]:
    """Time decisions on 16 to 1024 candidates.

    Returns:
        Medians by the number asked for, and the cost of 100 candidates more.
    """
    found = {}
    for count in CANDIDATES:
        rows = best_of(planner, shots, repeats=2, max_candidates=count)
        scored = float(np.mean([row["candidates"] for row in rows]))
        found[count] = {"candidates": scored, **_medians(rows)}
    few, many = found[CANDIDATES[0]], found[CANDIDATES[3]]
    more = max(many["candidates"] - few["candidates"], 1.0)
    return {
        "candidates": found,
        "ms_per_100_candidates": 100 * (many["total_ms"] - few["total_ms"]) / more,
        "cpu_ms_per_100_candidates": 100 * (many["cpu_ms"] - few["cpu_ms"]) / more,
    }


def by_threads(
    planner: GraspPlanner, shots: Sequence[Shot], threads: Sequence[int] = (1, 2)
) -> dict[int, dict[str, float]]:
    """Time decisions with as many threads."""
    found = {}
    for count in threads:
        other = GraspPlanner(replace(planner.config, threads=count), planner.gripper)
        found[count] = _medians(best_of(other, shots, repeats=2))
    return found


def by_table(
    planner: GraspPlanner, shots: Sequence[Shot], repeats: int = 3
) -> list[dict[str, Any]]:
    """Time decisions on tables, and count the objects in view without a candidate."""
    found = []
    for shot in shots:
        row = best_of(planner, [shot], repeats=repeats)[0]
        seen, bare = objects_without(planner, shot)
        found.append(
            {
                "size": list(shot.size),
                "objects": len(shot.positions),
                "in_view": seen,
                "without_candidate": bare,
                "cubes": row["cubes"],
                "candidates": row["candidates"],
                "memory_mb": peak_memory_mb(),
                **_medians([row]),
            }
        )
    return found


def objects_without(planner: GraspPlanner, shot: Shot) -> tuple[int, int]:
    """Return how many objects are in view, and how many of those have no candidate.

    An object is in view if voxels near a seen surface, above the table, lie beside it.
    """
    volume = shot.fused(planner.resolution)
    grasps = planner.sample(planner.encode(volume, time.time_ns()))
    voxels = np.argwhere(np.abs(volume.distances) < NEAR) + 0.5
    surface = voxels * volume.voxel_size
    surface = surface[surface[:, 2] > TABLE_TOP + ABOVE_TABLE]
    seen = bare = 0
    for position in shot.positions:
        beside = _beside(surface, position)
        if beside < LEAST_VOXELS:
            continue
        seen += 1
        bare += not _beside(grasps.poses[:, :3, 3], position)
    return seen, bare


def _beside(points: np.ndarray, position: np.ndarray) -> int:
    """Count points (N, 3) near a position, seen from above."""
    gaps = np.linalg.norm(points[:, :2] - position[:2], axis=1)
    return int((gaps < BESIDE).sum())


def by_resolution(shot: Shot, repeats: int = 3) -> dict[int, dict[str, float]]:
    """Time fusion and encoding on 40 to 128 voxels per edge.

    The networks have the plain U-Net and random weights: what they are asked afterwards
    grows with the surface, as the square.

    Returns:
        Milliseconds by voxels per edge, and peak memory of the process so far in [MB].
    """
    found = {}
    for count in RESOLUTIONS:
        step = 2 ** (NetworkConfig().unet_depth - 1)
        cells = count // 2 // step * step
        config = NetworkConfig(resolution=count, plane_resolution=cells)
        network = SceneNetwork(config).eval()
        fusion, encoding = [], []
        for _ in range(repeats):
            start = time.perf_counter()
            volume = shot.fused(count)
            fused = time.perf_counter()
            channels = torch.from_numpy(volume_channels(volume.distances))[None]
            with torch.no_grad():
                network.encode(channels)
            fusion.append(fused - start)
            encoding.append(time.perf_counter() - fused)
        found[count] = {
            "fusion_ms": 1e3 * min(fusion),
            "encoder_ms": 1e3 * min(encoding),
            "memory_mb": peak_memory_mb(),
        }
    return found


def _medians(rows: Sequence[dict[str, float]]) -> dict[str, float]:
    return {
        "total_ms": float(np.median([row["total"] for row in rows])),
        "cpu_ms": float(np.median([row["cpu"] for row in rows])),
    }
