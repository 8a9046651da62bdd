# SPDX-License-Identifier: Apache-2.0
"""Can this machine learn at all? Label four small scenes and overfit them."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from neugrasp_ros.config import NetworkConfig, TrainConfig
from neugrasp_ros.datagen.candidates import CandidateConfig
from neugrasp_ros.datagen.labels import SceneJob, SceneLabels, label_scene
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.training.batches import GraspCache
from neugrasp_ros.training.calibration import affordance_figures
from neugrasp_ros.training.metrics import roc_auc
from neugrasp_ros.training.occupancy import SceneCache, occupancy_iou
from neugrasp_ros.training.quality import predict
from neugrasp_ros.training.run import render_scenes, train_stage
from sim_bridge.objects.affordances import AFFORDANCE_NAMES

N_SCENES = 4
OBJECTS = ("affordance", "procedural")
SMALL_NETWORK = NetworkConfig(
    plane_resolution=16,
    channels=16,
    unet_depth=2,
    unet_channels=16,
    occupancy_hidden=32,
    occupancy_blocks=2,
    local_points=64,
    pointnet_width=32,
    pointnet_out=64,
    affordances=AFFORDANCE_NAMES,
)
STAGES = (
    TrainConfig(
        stage="occupancy", steps=300, scenes_per_step=4, points_per_scene=1024,
        learning_rate=3e-3,
    ),
    TrainConfig(
        stage="quality", steps=80, scenes_per_step=4, grasps_per_scene=16,
        w_affordance=1.0,
    ),
)  # fmt: skip
LEARNED_IOU = 0.4  # blades and handles are a voxel or two thick
LEARNED_AUC = 0.9
LEARNED_AP = 0.9


def smoke_test(folder: Path, seed: int = 0) -> dict[str, Any]:
    """Label four scenes, train a small network on them, and look at the same four.

    Args:
        folder: Scratch folder; a finished run in it is not repeated.
        seed: Seed of scenes and training.

    Returns:
        ``iou``, ``auc`` of the quality and ``ap`` of the affordances (mean over those
        that occur) on what was trained on, and ``learned``: all are high.
    """
    torch.manual_seed(seed)
    scenes = [_label(index, seed) for index in range(N_SCENES)]
    render_scenes(scenes, folder / "scenes", workers=1)
    network = GraspNetwork(SMALL_NETWORK)
    for config in STAGES:
        train_stage(network, config, folder, scenes)
    network.eval()
    scores = predict(network, GraspCache(folder / "grasps").entries)
    iou = occupancy_iou(network.scene, SceneCache(folder / "scenes"), N_SCENES)
    auc = roc_auc(scores.quality, scores.labels)
    classes = affordance_figures(scores, AFFORDANCE_NAMES).values()
    ap = float(np.nanmean([figures["ap"] for figures in classes]))
    learned = iou > LEARNED_IOU and auc > LEARNED_AUC and ap > LEARNED_AP
    return {
        "iou": iou,
        "auc": auc,
        "ap": ap,
        "grasps": len(scores.labels),
        "learned": bool(learned),
    }


def _label(index: int, seed: int) -> SceneLabels:
    return label_scene(
        SceneJob(
            index=index,
            seed=seed,
            kind="packed",
            objects=OBJECTS[index % len(OBJECTS)],
            split="train",
            gripper="panda",
            preset="fast",
            candidates=CandidateConfig(n_trials=12, n_collisions=4),
        )
    )
