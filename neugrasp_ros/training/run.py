# SPDX-License-Identifier: Apache-2.0
"""From labelled shards to a weights file: render, train in stages, calibrate."""

import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from neugrasp_ros.config import NetworkConfig, TrainConfig
from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.datagen.pool import process_pool
from neugrasp_ros.datagen.shards import load_shards
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.model import (
    ENCODER,
    GraspNetwork,
    file_sha256,
    save_network,
    warm_start,
)
from neugrasp_ros.training.batches import GraspCache
from neugrasp_ros.training.binding import bind_folder
from neugrasp_ros.training.cache import render_entry, save_entry
from neugrasp_ros.training.calibration import calibrate
from neugrasp_ros.training.context import ContextStage
from neugrasp_ros.training.device import training_device
from neugrasp_ros.training.distributed import (
    first_on_machine,
    is_first_process,
    own_share,
    processes,
)
from neugrasp_ros.training.grasps import cache_grasps, known_affordances
from neugrasp_ros.training.hands import HandStage
from neugrasp_ros.training.loop import optimise
from neugrasp_ros.training.occupancy import OccupancyStage, SceneCache
from neugrasp_ros.training.portable import drop_stage
from neugrasp_ros.training.quality import JointStage, QualityStage
from neugrasp_ros.training.views import ViewRange

LOGGER = logging.getLogger(__name__)

VIEWS_PER_SCENE = 3
GRASP_VIEWS_PER_SCENE = 2
FOLDER_STRIDE = 10_000_000  # keeps the scenes of several folders apart
SEEN_FROM = 1000 * FOLDER_STRIDE  # numbers of scenes that are only seen


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
        start: Weights to begin with; None = from nothing.
        seen: Folders of shards of which the stages ``hands`` and ``context`` learn
            points and hands: no local surfaces are rendered, which takes most of the
            time, and no other stage learns of them.
        keep: Folder of small files to commit, from which the run goes on where
            ``folder`` is lost; emptied when the weights are written.
    """

    train: tuple[Path, ...]
    tune: Path
    folder: Path
    weights: Path
    network: NetworkConfig
    stages: tuple[TrainConfig, ...]
    workers: int = 1
    start: Path | None = None
    seen: tuple[Path, ...] = ()
    keep: Path | None = None


DEFAULT_STAGES = (
    TrainConfig(stage="occupancy", steps=3600),
    TrainConfig(
        stage="quality", steps=3000, scenes_per_step=8, learning_rate=2e-3
    ),
    TrainConfig(
        stage="joint", steps=1500, grasps_per_scene=16, learning_rate=5e-4,
        constant_share=0.4, w_occupancy=4.0,
    ),
    TrainConfig(
        stage="hands", steps=6000, scenes_per_step=32, learning_rate=3e-3,
        weight_decay=1e-2, constant_share=0.4,
    ),
    TrainConfig(
        stage="context", steps=12_000, scenes_per_step=4, grasps_per_scene=16,
        learning_rate=3e-3, weight_decay=1e-2, constant_share=0.3,
    ),
)  # fmt: skip


def train(run: TrainingRun) -> dict[str, Any]:
    """Run all stages and write the weights.

    Heads for affordances need labels: if no scene has them, they are left out.

    Args:
        run: Data, folders, network and stages.

    Returns:
        The card: figures on the tuning split, and what they were trained on. Of the
        processes of a ``torchrun`` the first returns it, the others nothing.

    Raises:
        CheckpointError: If the weights to begin with do not fit the network.
        ConfigError: If their encoder does not fit, and no stage would teach a new one;
            or if the folder was begun with something else.
    """
    scenes, seen = _numbered(run.train), _numbered(run.seen, SEEN_FROM)
    tune = list(load_shards(run.tune))
    with processes():
        network = _run_stages(run, scenes, seen, tune)
        return _finish(run, network, scenes, seen, tune) if is_first_process() else {}


def _numbered(folders: Sequence[Path], first: int = 0) -> list[SceneLabels]:
    """Return the scenes of folders, their numbers apart."""
    return [
        replace(labels, index=first + number * FOLDER_STRIDE + labels.index)
        for number, folder in enumerate(folders)
        for labels in load_shards(folder)
    ]


def _run_stages(
    run: TrainingRun,
    scenes: Sequence[SceneLabels],
    seen: Sequence[SceneLabels],
    tune: Sequence[SceneLabels],
) -> GraspNetwork:
    """Render what is missing, train, and return the network."""
    network = _new_network(run, scenes)
    with first_on_machine() as mine:
        if mine:
            uses = {"train": scenes, "seen": seen, "tune": tune}
            bind_folder(run.folder, run.network, run.stages, run.start, uses)
            render_scenes([*scenes, *seen], run.folder / "scenes", run.workers)
            render_scenes(tune, run.folder / "tune_scenes", run.workers)
    for config in run.stages:
        if _is_left_out(config.stage, network):
            LOGGER.info("stage %s is left out: it teaches nothing here", config.stage)
            continue
        torch.set_num_threads(config.threads or torch.get_num_threads())
        train_stage(
            network, config, run.folder, scenes,
            seen=seen, workers=run.workers, keep=run.keep,
        )  # fmt: skip
        LOGGER.info("stage %s is done", config.stage)
    network.eval()
    return network


def _finish(
    run: TrainingRun,
    network: GraspNetwork,
    scenes: Sequence[SceneLabels],
    seen: Sequence[SceneLabels],
    tune: Sequence[SceneLabels],
) -> dict[str, Any]:
    """Calibrate, write the weights, and return their card."""
    stages = [s for s in run.stages if not _is_left_out(s.stage, network)]
    card: dict[str, Any] = {"stages": [asdict(stage) for stage in stages]}
    if run.start is not None:
        card["start"] = file_sha256(run.start)
    learned = bool({stage.stage for stage in run.stages} - {"hands", "context"})
    card |= calibrate(network, run.folder, tune, quality=learned or run.start is None)
    card["scenes"] = len(scenes)
    card["labels"] = int(sum(s.grasps.judged().sum() for s in scenes))
    card["grasps"] = sum(len(s.grasps) for s in scenes)
    card["trials"] = int(sum(s.grasps.tried.sum() for s in scenes))
    card["seen_scenes"] = len(seen)
    save_network(network, run.weights, card)
    if run.keep is not None:
        for stage in run.stages:
            drop_stage(run.keep, stage.stage)
    return card


def _new_network(run: TrainingRun, scenes: Sequence[SceneLabels]) -> GraspNetwork:
    """Return the network to train, with the weights it begins with."""
    torch.manual_seed(run.stages[0].seed)
    config = run.network
    known = sum(int(known_affordances(labels).sum()) for labels in scenes)
    if config.affordances and not known:
        LOGGER.info("no scene has affordance labels: the heads are left out")
        config = replace(
            config,
            affordances=(), part_head=False, thing_head=False, context=0, hand_view=0,
        )  # fmt: skip
    network = GraspNetwork(config)
    stages = {stage.stage for stage in run.stages}
    if stages <= {"hands", "context"} and not config.context:
        raise ConfigError(
            f"the stages {sorted(stages)} alone teach a network without context nothing"
        )
    if config.context and "context" not in stages:
        LOGGER.warning(
            "the affordance head stays as it is while what it reads may change: teach "
            "it afterwards with the stage 'context'"
        )
    if run.start is not None:
        fresh = warm_start(network, run.start)
        LOGGER.info("began with %s; new: %s", run.start, ", ".join(fresh) or "nothing")
        learned = stages & {"occupancy", "joint"}
        if any(key.startswith(ENCODER) for key in fresh) and not learned:
            raise ConfigError(
                f"{run.start} has another scene encoder: the new one needs the stage "
                "occupancy or joint"
            )
    return network


def train_stage(
    network: GraspNetwork,
    config: TrainConfig,
    folder: Path,
    scenes: Sequence[SceneLabels],
    *,
    seen: Sequence[SceneLabels] = (),
    workers: int = 1,
    keep: Path | None = None,
) -> None:
    """Run one stage on its device, preparing what it reads on several processes.

    Args:
        network: Trained in place; on the CPU before and after.
        config: The stage.
        folder: The run's folder.
        scenes: The labelled scenes.
        seen: Scenes of which the stages ``hands`` and ``context`` alone learn.
        workers: Processes that look at grasps.
        keep: Folder of small copies of the state, see ``optimise``.
    """
    network.train()
    try:
        if config.stage == "hands":
            network.to(training_device(config))
            cache = SceneCache(folder / "scenes", own_share)
            hands = HandStage(network, cache, config, [*scenes, *seen])
            optimise(network, hands, config, folder / config.stage, keep)
        elif config.stage == "occupancy":
            network.to(training_device(config))
            cache = SceneCache(folder / "scenes", _unseen)
            stage = OccupancyStage(network.scene, cache, config)
            optimise(network.scene, stage, config, folder / config.stage, keep)
        else:
            network.eval()
            with first_on_machine() as mine:
                if mine:
                    cache_grasps(
                        scenes, network.scene, folder / "grasps", few_collisions=True,
                        n_views=GRASP_VIEWS_PER_SCENE, seed=config.seed,
                        workers=workers,
                    )  # fmt: skip
            _teach_grasps(network, config, folder, [*scenes, *seen], keep)
    finally:
        network.cpu().requires_grad_(True)


def _is_left_out(stage: str, network: GraspNetwork) -> bool:
    """Tell whether a network has nothing that a stage would teach."""
    return {"context": network.context, "hands": network.hands}.get(stage, network) is (
        None
    )


def _teach_grasps(
    network: GraspNetwork,
    config: TrainConfig,
    folder: Path,
    scenes: Sequence[SceneLabels],
    keep: Path | None,
) -> None:
    """Run a stage that learns from cached grasps; it freezes what it does not teach."""
    grasps = GraspCache(folder / "grasps", own_share)
    network.train().to(training_device(config))
    if network.context is not None and config.stage != "context":
        detector: Any = network.detector
        for part in (network.context, detector.affordance, network.hands):
            if part is not None:
                part.eval().requires_grad_(False)
    out = folder / config.stage
    if config.stage == "quality":
        network.scene.eval()  # with its running statistics, as when it is used
        quality = QualityStage(network, grasps, config)
        optimise(network.detector, quality, config, out, keep)
        return
    if config.stage == "context":
        rendered = SceneCache(folder / "scenes", own_share)
        context = ContextStage(network, grasps, rendered, config, scenes)
        optimise(network, context, config, out, keep)
        return
    rendered = SceneCache(folder / "scenes", _unseen)
    occupancy = OccupancyStage(network.scene, rendered, config)
    joint = JointStage(network, grasps, config, occupancy)
    optimise(network, joint, config, out, keep)


def _unseen(paths: Sequence[Path]) -> Sequence[Path]:
    """Return this process's share of the scenes that are not seen alone."""
    return own_share([path for path in paths if int(path.stem) < SEEN_FROM])


def render_scenes(scenes: Sequence[SceneLabels], folder: Path, workers: int) -> None:
    """Render the scenes that are not in the folder yet, on several processes."""
    folder.mkdir(parents=True, exist_ok=True)
    todo = [s for s in scenes if s.scene.objects and not _path(s, folder).exists()]
    if not todo:
        return
    LOGGER.info("rendering %d scenes", len(todo))
    with process_pool(workers) as pool:
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
