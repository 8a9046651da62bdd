# SPDX-License-Identifier: Apache-2.0
"""Losses over the steps: scalars for TensorBoard, and one picture."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from torch.utils.tensorboard import SummaryWriter

SIZE = (7.0, 4.0)  # [inch]


class Curves:
    """Keeps the losses of a stage where they can be looked at.

    Args:
        folder: Gets ``tensorboard/`` and ``curves.png``.
        start: First step of this run; scalars from there on are replaced.
    """

    def __init__(self, folder: Path, start: int) -> None:
        self._folder = folder
        self._writer = SummaryWriter(str(folder / "tensorboard"), purge_step=start)

    def add(self, means: dict[str, float], learning_rate: float) -> None:
        """Add mean losses; the key ``step`` says where."""
        step = int(means["step"])
        for name, value in means.items():
            if name != "step":
                self._writer.add_scalar(f"loss/{name}", value, step)
        self._writer.add_scalar("learning_rate", learning_rate, step)

    def close(self, history: Sequence[dict[str, float]]) -> None:
        """Write what is left, and the picture of the whole history."""
        self._writer.close()
        draw_curves(history, self._folder / "curves.png")


def draw_curves(history: Sequence[dict[str, float]], path: Path) -> None:
    """Draw each loss over the steps.

    Args:
        history: Mean losses, with the key ``step``, in the order of the steps.
        path: PNG.
    """
    figure = Figure(figsize=SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    names = {name: None for means in history for name in means if name != "step"}
    for name in names:
        rows = [means for means in history if name in means]
        axes.plot([m["step"] for m in rows], [m[name] for m in rows], label=name)
    axes.set_xlabel("step")
    axes.set_ylabel("weighted loss")
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    if names:
        axes.legend()
    figure.savefig(path, dpi=120)
