# SPDX-License-Identifier: Apache-2.0
"""The optimisation loop that all stages share: schedule, progress, checkpoints.

Started by ``torchrun``, all processes begin with the first one's weights, every process
draws its own scenes, and gradients are averaged by ``torch.distributed``.
"""

import json
import logging
import os
import pickle
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.errors import CheckpointError
from neugrasp_ros.training.curves import Curves
from neugrasp_ros.training.device import device_of, mixed_precision
from neugrasp_ros.training.distributed import (
    average_gradients,
    first_on_machine,
    is_first_process,
    process_count,
    process_rank,
    share_weights,
)
from neugrasp_ros.training.portable import STATE_FILE, pack_stage, unpack_stage

LOGGER = logging.getLogger(__name__)
REPORT_SECONDS = 15.0
GRADIENT_NORM = 1.0  # gradients are clipped to this length

DAMAGED = (
    KeyError, TypeError, ValueError, OSError, EOFError, RuntimeError,
    pickle.UnpicklingError,
)  # fmt: skip
"""What reading half a state, or another model's, raises."""

LossFunction = Callable[[int], dict[str, Tensor]]


def learning_rate_at(step: int, config: TrainConfig) -> float:
    """Return the step size: short warm-up, constant, then linearly down to 1 %."""
    warmup = min(1.0, (step + 1) / 50)
    start = config.constant_share * config.steps
    fall = max(0.0, (step - start) / max(1.0, config.steps - start))
    return config.learning_rate * warmup * (1.0 - 0.99 * fall)


@dataclass
class Progress:
    """Running means of the losses, with a rate and an estimate of what is left."""

    steps: int
    started: float = field(default_factory=time.monotonic)
    reported: float = field(default_factory=time.monotonic)
    done: int = 0
    sums: dict[str, float] = field(default_factory=dict)
    count: int = 0
    history: list[dict[str, float]] = field(default_factory=list)

    def add(self, step: int, losses: dict[str, Tensor]) -> bool:
        """Add one step's losses; log a line every quarter of a minute.

        Returns:
            Whether the history has grown.
        """
        self.done += 1
        self.count += 1
        for name, value in losses.items():
            self.sums[name] = self.sums.get(name, 0.0) + float(value.detach())
        now = time.monotonic()
        if now - self.reported < REPORT_SECONDS and step + 1 < self.steps:
            return False
        means = {name: total / self.count for name, total in self.sums.items()}
        rate = self.done / (now - self.started)
        left = (self.steps - step - 1) / rate
        self.history.append({"step": step + 1, **means})
        text = ", ".join(f"{name} {value:.4f}" for name, value in means.items())
        LOGGER.info(
            "step %d/%d  %s  %.2f steps/s  %.0f min left",
            step + 1, self.steps, text, rate, left / 60,
        )  # fmt: skip
        self.reported, self.count, self.sums = now, 0, {}
        return True


def optimise(
    model: nn.Module,
    loss_of_step: LossFunction,
    config: TrainConfig,
    folder: Path,
    keep: Path | None = None,
) -> list[dict[str, float]]:
    """Run (or go on with) a stage.

    Args:
        model: The trained parameters are those that require gradients.
        loss_of_step: Returns the named losses of a step; they are summed. With
            several processes each gets numbers of its own, and so draws its own batch.
        config: Steps, step size, checkpoint interval.
        folder: Holds ``state.pt``, from which a killed run goes on, ``history.json``,
            ``curves.png``, and scalars for TensorBoard.
        keep: Gets small copies of the state, from which a run on another machine goes
            on, see ``training.portable``.

    Returns:
        Mean losses over time.

    Raises:
        CheckpointError: If the state in the folder is of another stage or damaged.
    """
    trained = [p for p in model.parameters() if p.requires_grad]
    optimiser = torch.optim.AdamW(
        trained, lr=config.learning_rate, weight_decay=config.weight_decay
    )
    folder.mkdir(parents=True, exist_ok=True)
    progress = Progress(config.steps)
    with first_on_machine() as mine:
        if mine and keep is not None:
            unpack_stage(keep, folder)
    start = _restore(folder / STATE_FILE, model, optimiser, config, progress)
    share_weights(model)
    curves = Curves(folder, start) if is_first_process() else None
    saved = time.monotonic()
    for step in range(start, config.steps):
        for group in optimiser.param_groups:
            group["lr"] = learning_rate_at(step, config)
        with mixed_precision(config, device_of(model)):
            losses = loss_of_step(step * process_count() + process_rank())
        optimiser.zero_grad(set_to_none=True)
        torch.stack(list(losses.values())).sum().backward()
        average_gradients(trained)
        nn.utils.clip_grad_norm_(trained, GRADIENT_NORM)
        optimiser.step()
        if progress.add(step, losses) and curves:
            curves.add(progress.history[-1], learning_rate_at(step, config))
        if time.monotonic() - saved > config.checkpoint_seconds:
            _save(folder, model, optimiser, config, step + 1, progress)
            _keep(folder, keep, config)
            saved = time.monotonic()
    share_weights(model)  # running statistics are each process's own until here
    _save(folder, model, optimiser, config, config.steps, progress)
    _keep(folder, keep, config)
    if curves:
        curves.close(progress.history)
    return progress.history


def _save(
    folder: Path,
    model: nn.Module,
    optimiser: torch.optim.Optimizer,
    config: TrainConfig,
    step: int,
    progress: Progress,
) -> None:
    if not is_first_process():
        return
    state = {
        "stage": config.stage,
        "step": step,
        "model": model.state_dict(),
        "optimiser": optimiser.state_dict(),
        "history": progress.history,
        "random": torch.get_rng_state(),  # dropout goes on where it was
    }
    part = folder / "state.part"
    torch.save(state, part)
    os.replace(part, folder / STATE_FILE)
    (folder / "history.json").write_text(json.dumps(progress.history))


def _keep(folder: Path, keep: Path | None, config: TrainConfig) -> None:
    if keep is not None and is_first_process():
        pack_stage(folder, keep, config.steps)


def _restore(
    path: Path,
    model: nn.Module,
    optimiser: torch.optim.Optimizer,
    config: TrainConfig,
    progress: Progress,
) -> int:
    if not path.exists():
        return 0
    try:
        state: dict[str, Any] = torch.load(path, weights_only=True)
        if state["stage"] != config.stage:
            raise CheckpointError(
                path, f"is of stage {state['stage']!r}, expected {config.stage!r}"
            )
        model.load_state_dict(state["model"])
        optimiser.load_state_dict(state["optimiser"])
        torch.set_rng_state(state.get("random", torch.get_rng_state()))
        progress.history = list(state["history"])
        start = int(state["step"])
    except DAMAGED as error:
        raise CheckpointError(path, f"cannot be resumed from ({error})") from error
    LOGGER.info("going on from step %d", start)
    return start
