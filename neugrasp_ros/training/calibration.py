# SPDX-License-Identifier: Apache-2.0
"""Make the predicted probabilities honest on the tuning split."""

import hashlib
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.model import GraspNetwork
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.training.batches import GraspCache
from neugrasp_ros.training.figures import affordance_figures, quality_figures
from neugrasp_ros.training.grasps import cache_grasps
from neugrasp_ros.training.metrics import platt_scaling
from neugrasp_ros.training.occupancy import SceneCache, occupancy_iou
from neugrasp_ros.training.quality import predict

IOU_SCENES = 200
MIN_EXAMPLES = 10  # of either kind; with fewer a class keeps its raw probability


def calibrate(
    network: GraspNetwork,
    folder: Path,
    tune: Sequence[SceneLabels],
    *,
    quality: bool = True,
) -> dict[str, Any]:
    """Fit the calibration on the tuning split and say how good the network is there.

    Quality and every affordance class get a scale and a bias of their own. The figures
    of a split that was calibrated on are a little optimistic; reports use the
    validation split.

    Args:
        network: Gets its calibration.
        folder: The run's; holds the rendered scenes of the split.
        tune: The split.
        quality: Fit that of the quality too, and not of the affordances alone.
    """
    renders = _renders_of(network.scene, folder)
    cache_grasps(tune, network.scene, renders, n_views=1, seed=1)
    entries = GraspCache(renders).entries
    classes = network.config.affordances
    if quality:
        network.calibration.copy_(torch.tensor([1.0, 0.0]))
    if classes:
        same = torch.tensor([1.0, 0.0]).repeat(len(classes), 1)
        network.affordance_calibration.copy_(same)
    raw = predict(network, entries)
    if quality:
        fitted = platt_scaling(raw.quality[raw.judged], raw.labels[raw.judged])
        network.calibration.copy_(torch.tensor(fitted))
    for column in range(len(classes)):
        afforded = raw.afforded[raw.known, column]
        if min(afforded.sum(), (1 - afforded).sum()) < MIN_EXAMPLES:
            continue
        fitted = platt_scaling(raw.affordances[raw.known, column], afforded)
        network.affordance_calibration[column] = torch.tensor(fitted)
    scores = predict(network, entries)
    iou = occupancy_iou(network.scene, SceneCache(folder / "tune_scenes"), IOU_SCENES)
    figures: dict[str, Any] = {"tune": {**quality_figures(scores), "iou": iou}}
    if classes:
        figures["tune_affordances"] = affordance_figures(scores, classes)
    return figures


def _renders_of(scene: SceneNetwork, folder: Path) -> Path:
    """Return where a scene network's own renders go; those of others are removed."""
    digest = hashlib.sha256()
    for tensor in scene.state_dict().values():
        digest.update(tensor.numpy().tobytes())
    mine = folder / f"tune_grasps_{digest.hexdigest()[:8]}"
    for other in set(folder.glob("tune_grasps*")) - {mine}:
        shutil.rmtree(other)
    return mine
