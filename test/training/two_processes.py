# SPDX-License-Identifier: Apache-2.0
"""Started by ``torchrun`` in a test: trains a line and writes what it ends with."""

import json
import sys
from pathlib import Path

import torch

from neugrasp_ros.config import TrainConfig
from neugrasp_ros.training.distributed import (
    first_on_machine,
    own_share,
    process_rank,
    processes,
    share_weights,
)
from neugrasp_ros.training.loop import optimise

CONFIG = TrainConfig(steps=4, learning_rate=0.05)


def main() -> None:
    """Train four steps."""
    folder = Path(sys.argv[1])
    with processes():
        rank = process_rank()
        with first_on_machine() as mine:
            if mine:
                (folder / "once.txt").write_text(str(rank))
        torch.manual_seed(rank)
        model = torch.nn.Sequential(torch.nn.BatchNorm1d(3), torch.nn.Linear(3, 1))
        drawn = model[1].weight.tolist()
        share_weights(model)
        first, steps = model[1].weight.tolist(), []

        def loss(step: int) -> dict[str, torch.Tensor]:
            steps.append(step)
            x = torch.randn(8, 3, generator=torch.Generator().manual_seed(step))
            return {"fit": (model(x) - x.sum(1, keepdim=True)).square().mean()}

        optimise(model, loss, CONFIG, folder)
        report = {
            "drawn": drawn, "first": first, "steps": steps,
            "weights": model[1].weight.tolist(),
            "statistics": model[0].running_mean.tolist(),
            "share": own_share("abcde"), "scarce": own_share("a"),
        }  # fmt: skip
        (folder / f"rank_{rank}.json").write_text(json.dumps(report))


if __name__ == "__main__":
    main()
