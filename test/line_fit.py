# SPDX-License-Identifier: Apache-2.0
"""A small model that learns a line, and can be killed while it does."""

import torch
from torch import nn

from neugrasp_ros.config import TrainConfig

CONFIG = TrainConfig(steps=60, learning_rate=0.05, checkpoint_seconds=1.0)


class Killed(BaseException):
    """Stands for a signal."""


def small_model() -> nn.Module:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(3, 8), nn.ReLU(), nn.Dropout(0.3), nn.Linear(8, 1))


class LineFit:
    """The loss of a step depends on its number and on the model's dropout."""

    def __init__(self, model: nn.Module, killed_at: int | None = None) -> None:
        self.model, self.killed_at, self.steps = model, killed_at, []

    def __call__(self, step: int) -> dict[str, torch.Tensor]:
        if step == self.killed_at:
            raise Killed
        self.steps.append(step)
        x = torch.randn(16, 3, generator=torch.Generator().manual_seed(step))
        wanted = x.sum(dim=1, keepdim=True)
        return {"fit": (self.model(x) - wanted).square().mean()}
