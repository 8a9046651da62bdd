# SPDX-License-Identifier: Apache-2.0
"""One decision at a glance: seen, completed, proposed, chosen, and what came of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.pictures.scene_axes import (
    QUALITY_COLORS,
    draw_grippers,
    draw_surface,
    frame_cube,
)

FloatArray = NDArray[np.float64]

SHOWN_CANDIDATES = 70
CLOSE_UP = 0.22  # [m], least edge of the cube shown around what was found
SHOWN_GRASPS = 12
DPI = 110


@dataclass(frozen=True, eq=False)
class Attempt:
    """One executed grasp.

    Attributes:
        quality: Predicted probability of success.
        width: Commanded opening in [m].
        success: Whether the object was held.
        result: In words.
        grasp: Name of the grasp in the answer that it comes from.
    """

    quality: float
    width: float
    success: bool
    result: str
    grasp: str = ""


@dataclass(frozen=True, eq=False)
class Decision:
    """Everything that the picture shows; poses and points in one frame.

    Attributes:
        depth: Depth image in [m], shape (H, W), NaN = not measured.
        surface: Completed surface, shape (N, 3) in [m].
        candidates: Poses of the candidates, shape (C, 4, 4).
        candidate_widths: Shape (C,) in [m].
        grasps: Poses of the ranked grasps, best first, shape (G, 4, 4).
        widths: Shape (G,) in [m].
        quality: Shape (G,).
        lower: Lower corner of the workspace in [m], shape (3,).
        edge: Edge of the workspace in [m].
    """

    depth: NDArray[np.float32]
    surface: FloatArray
    candidates: FloatArray
    candidate_widths: FloatArray
    grasps: FloatArray
    widths: FloatArray
    quality: FloatArray
    lower: FloatArray
    edge: float


def draw_decision(
    decision: Decision,
    attempts: list[Attempt],
    gripper: Gripper,
    path: Path,
    title: str,
) -> None:
    """Write the picture of a decision.

    Args:
        decision: What was seen and computed.
        attempts: What came of it and of the attempts after it.
        gripper: The gripper.
        path: A ``.png`` file.
        title: Headline.
    """
    figure = Figure(figsize=(19, 4.6), dpi=DPI)
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=13)
    grid = figure.add_gridspec(1, 5, width_ratios=(1.2, 1, 1, 1, 0.9), wspace=0.04)
    draw_depth(figure.add_subplot(grid[0]), decision.depth)
    panels = [figure.add_subplot(grid[i], projection="3d") for i in (1, 2, 3)]
    draw_surface(panels[0], decision.surface)
    some = slice(0, SHOWN_CANDIDATES)
    draw_surface(panels[1], decision.surface, c="#b8c4d0", cmap=None, s=2)
    draw_grippers(
        panels[1],
        decision.candidates[some],
        decision.candidate_widths[some],
        gripper,
        colors="#3b6ea580",
        linewidth=0.6,
    )
    draw_surface(panels[2], decision.surface, c="#b8c4d0", cmap=None, s=2)
    _draw_ranked(panels[2], decision, gripper)
    titles = (
        f"surface ({len(decision.surface)} points)",
        f"{len(decision.candidates)} candidates",
        f"{len(decision.grasps)} ranked grasps, best in bold",
    )
    lower, edge = close_up(decision)
    for axes, text in zip(panels, titles, strict=True):
        frame_cube(axes, lower, edge, text)
    _draw_attempts(figure.add_subplot(grid[4]), attempts)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches="tight")


def close_up(decision: Decision) -> tuple[FloatArray, float]:
    """Return corner and edge of a cube around the surface, or the whole workspace."""
    if not len(decision.surface) or decision.edge <= CLOSE_UP:
        return decision.lower, decision.edge
    low, high = decision.surface.min(axis=0), decision.surface.max(axis=0)
    edge = max(CLOSE_UP, float((high - low).max()))
    return (low + high - edge) / 2, edge


def draw_depth(axes: Any, depth: NDArray[np.float32]) -> None:
    """Add the picture of a depth image (H, W) in [m], NaN = not measured."""
    valid = depth[np.isfinite(depth) & (depth > 0)]
    low, high = np.percentile(valid, (1, 95)) if len(valid) else (0.0, 1.0)
    axes.imshow(depth, cmap="magma_r", vmin=low, vmax=high)
    axes.set_title("depth of the head camera", fontsize=10)
    axes.set_axis_off()


def _draw_ranked(axes: Any, decision: Decision, gripper: Gripper) -> None:
    shown = slice(0, SHOWN_GRASPS)
    colors = QUALITY_COLORS(np.clip(decision.quality[shown], 0, 1))
    draw_grippers(
        axes, decision.grasps[shown][1:], decision.widths[shown][1:], gripper,
        colors=colors[1:], linewidth=1.0,
    )  # fmt: skip
    draw_grippers(
        axes, decision.grasps[:1], decision.widths[:1], gripper,
        colors=colors[:1], linewidth=3.0,
    )  # fmt: skip


def _draw_attempts(axes: Any, attempts: list[Attempt]) -> None:
    axes.set_title("predicted quality and outcome", fontsize=10)
    rows = np.arange(len(attempts))
    colors = ["#2e8b57" if a.success else "#c0392b" for a in attempts]
    axes.barh(rows, [a.quality for a in attempts], color=colors, height=0.6)
    for row, attempt in zip(rows, attempts, strict=True):
        text = f"{row + 1}: {attempt.result} ({attempt.quality:.2f})"
        axes.text(0.02, row, text, va="center", fontsize=8, color="white")
    axes.set_xlim(0, 1)
    axes.set_ylim(max(5.5, len(attempts)) - 0.5, -0.5)
    axes.set_yticks([])
    axes.tick_params(axis="x", labelsize=7)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
