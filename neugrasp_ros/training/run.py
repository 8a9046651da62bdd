# SPDX-License-Identifier: Apache-2.0
"""From labelled shards to a weights file: render, train in stages, calibrate."""

import logging
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neugrasp_ros.config import NetworkConfig, TrainConfig
from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.datagen.shards import load_shards
from neugrasp_ros.model import GraspNetwork, save_network
from neugrasp_ros.training.cache import render_entry, save_entry
from neugrasp_ros.training.grasps import cache_grasps
from neugrasp_ros.training.loop import optimise
from neugrasp_ros.training.metrics import (
    average_precision,
    expected_calibration_error,
    platt_scaling,
    roc_auc,
)
from neugrasp_ros.training.occupancy import OccupancyStage, SceneCache, occupancy_iou
from neugrasp_ros.training.quality import GraspCache, JointStage, QualityStage, predict
from neugrasp_ros.training.views import ViewRange

LOGGER = logging.getLogger(__name__)

VIEWS_PER_SCENE = 3
GRASP_VIEWS_PER_SCENE = 2
IOU_SCENES = 200
FOLDER_STRIDE = 10_000_000  # keeps the scenes of several folders apart


@dataclass(frozen=True, kw_only=True)
class TrainingRun:
    """What to train on, and where it goes.

    Attributes:
        train: Folders of shards to learn from.
        tune: Folder of shards to calibrate on.
        folder: Everything that the run writes; a killed run goes on from it.
        weights: Where the weights go in the end.
        network: Shape of the network.
        stages: The stages in order; a stage that is done is skipped.
        workers: Processes that render scenes.
    """

    train: tuple[Path, ...]
    tune: Path
    folder: Path
    weights: Path
    network: NetworkConfig
    stages: tuple[TrainConfig, ...]
    workers: int = 1


DEFAULT_STAGES = (
    TrainConfig(stage="occupancy", steps=3600),
    TrainConfig(
        stage="quality", steps=3000, scenes_per_step=8, learning_rate=2e-3
    ),
    TrainConfig(
        stage="joint", steps=600, scenes_per_step=4, learning_rate=2e-4,
        constant_share=0.2,
    ),
)  # fmt: skip


def train(run: TrainingRun) -> dict[str, Any]:
    """Run all stages and write the weights.

    Args:
        run: Data, folders, network and stages.

    Returns:
        The card: figures on the tuning split, and what they were trained on.
    """
    torch.manual_seed(run.stages[0].seed)
    network = GraspNetwork(run.network)
    scenes = [
        replace(labels, index=number * FOLDER_STRIDE + labels.index)
        for number, folder in enumerate(run.train)
        for labels in load_shards(folder)
    ]
    tune = list(load_shards(run.tune))
    render_scenes(scenes, run.folder / "scenes", run.workers)
    render_scenes(tune, run.folder / "tune_scenes", run.workers)
    card: dict[str, Any] = {"stages": [asdict(stage) for stage in run.stages]}
    for config in run.stages:
        torch.set_num_threads(config.threads or torch.get_num_threads())
        train_stage(network, config, run.folder, scenes)
        LOGGER.info("stage %s is done", config.stage)
    network.eval()
    card |= calibrate(network, run.folder, tune)
    card["scenes"] = len(scenes)
    card["labels"] = int(sum(len(s.grasps.labels) for s in scenes))
    card["trials"] = int(sum(s.grasps.tried.sum() for s in scenes))
    save_network(network, run.weights, card)
    return card


def train_stage(
    network: GraspNetwork,
    config: TrainConfig,
    folder: Path,
    scenes: Sequence[SceneLabels],
) -> None:
    """Run one stage, preparing what it reads."""
    network.train()
    out = folder / config.stage
    if config.stage == "occupancy":
        stage = OccupancyStage(network.scene, SceneCache(folder / "scenes"), config)
        optimise(network.scene, stage, config, out)
        return
    network.eval()
    cache_grasps(
        scenes, network.scene, folder / "grasps",
        n_views=GRASP_VIEWS_PER_SCENE, seed=config.seed,
    )  # fmt: skip
    grasps = GraspCache(folder / "grasps")
    network.train()
    if config.stage == "quality":
        optimise(network.detector, QualityStage(network, grasps, config), config, out)
        return
    occupancy = OccupancyStage(network.scene, SceneCache(folder / "scenes"), config)
    joint = JointStage(network, grasps, config, occupancy)
    optimise(network, joint, config, out)


def calibrate(
    network: GraspNetwork, folder: Path, tune: Sequence[SceneLabels]
) -> dict[str, Any]:
    """Fit the calibration on the tuning split and say how good the network is there.

    The figures of a split that was calibrated on are a little optimistic; reports use
    the validation split.
    """
    cache_grasps(tune, network.scene, folder / "tune_grasps", n_views=1, seed=1)
    grasps = GraspCache(folder / "tune_grasps")
    network.calibration.copy_(torch.tensor([1.0, 0.0]))
    raw, labels = predict(network, grasps)
    network.calibration.copy_(torch.tensor(platt_scaling(raw, labels)))
    probabilities, labels = predict(network, grasps)
    return {
        "tune": {
            "grasps": len(labels),
            "positive": float(np.mean(labels)),
            "auc": roc_auc(probabilities, labels),
            "ap": average_precision(probabilities, labels),
            "ece": expected_calibration_error(probabilities, labels),
            "iou": occupancy_iou(
                network.scene, SceneCache(folder / "tune_scenes"), IOU_SCENES
            ),
        }
    }


def render_scenes(scenes: Sequence[SceneLabels], folder: Path, workers: int) -> None:
    """Render the scenes that are not in the folder yet, on several processes."""
    folder.mkdir(parents=True, exist_ok=True)
    todo = [s for s in scenes if s.scene.objects and not _path(s, folder).exists()]
    if not todo:
        return
    LOGGER.info("rendering %d scenes", len(todo))
    context = get_context("spawn")
    with ProcessPoolExecutor(max(1, workers), mp_context=context) as pool:
        done = pool.map(_render_one, todo, [folder] * len(todo), chunksize=8)
        for count, _ in enumerate(done, start=1):
            if count % 100 == 0:
                LOGGER.info("rendered %d/%d", count, len(todo))


def _path(labels: SceneLabels, folder: Path) -> Path:
    return folder / f"{labels.index:07d}.npz"


def _render_one(labels: SceneLabels, folder: Path) -> None:
    rng = np.random.default_rng([labels.scene.seed % 2**31, labels.index])
    entry = render_entry(labels.scene, ViewRange(), rng, n_views=VIEWS_PER_SCENE)
    save_entry(entry, _path(labels, folder))
