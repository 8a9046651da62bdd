# SPDX-License-Identifier: Apache-2.0
"""Grasps on the seen surface alone: the ablation without scene rendering."""

from dataclasses import replace

import numpy as np
from diamond import AFFORDING_NETWORK, EDGE, diamond_network

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.fusion.tsdf import empty_volume
from neugrasp_ros.model import save_network
from neugrasp_ros.pipeline import GraspPlanner
from neugrasp_ros.pipeline.scenes import seen_scene

SIZE = AFFORDING_NETWORK.resolution
CENTER, RADIUS = np.array([0.15, 0.15, 0.09]), 0.04  # [m]


def planner_of(folder, **changes) -> GraspPlanner:
    path = folder / "diamond.safetensors"
    save_network(diamond_network(AFFORDING_NETWORK, CENTER, RADIUS), path)
    settings = PlannerConfig(weights=str(path), gripper="panda", threads=1, **changes)
    return GraspPlanner(settings)


def test_without_scene_render_grasps_are_sampled_on_what_was_seen(tmp_path):
    """A ball of which the upper half was seen; nothing is rendered."""
    centers = (np.arange(SIZE) + 0.5) * EDGE / SIZE
    points = np.stack(np.meshgrid(centers, centers, centers, indexing="ij"), axis=-1)
    distances = (np.linalg.norm(points - CENTER, axis=-1) - RADIUS) / 0.02
    distances[points[..., 2] < CENTER[2]] = np.nan
    clipped = np.clip(distances, -1, 1).astype(np.float32)
    volume = replace(empty_volume(SIZE, EDGE), distances=clipped, view_count=1)
    planner = planner_of(tmp_path, scene_render=False)
    seen = seen_scene(volume, 0.05, planner.config.render)
    off = np.linalg.norm(seen.points - CENTER, axis=1) - RADIUS
    assert np.abs(off).max() < 0.003
    assert seen.points[:, 2].min() > CENTER[2]
    shaved = seen_scene(volume, CENTER[2] + 0.01, planner.config.render)
    assert 0 < len(shaved.points) < len(seen.points)
    assert len(seen_scene(volume, 0.2, planner.config.render).points) == 0
    scene = planner.encode(volume, revision=1)
    planner.render = None
    assert len(planner.sample(scene, support_height=None, seed=3)) > 0
