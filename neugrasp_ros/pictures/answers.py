# SPDX-License-Identifier: Apache-2.0
"""One scene, asked about every affordance: the answers side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.pictures.decision import draw_depth
from neugrasp_ros.pictures.scene_axes import draw_grippers, draw_surface, frame_box

FloatArray = NDArray[np.float64]

COLUMNS = 4
SHOWN_GRASPS = 6
DPI = 110
LEAST_EDGE = 0.2  # [m], of the box shown
FOR_HANDS = 0.08  # [m] above the surface
ZOOM = 1.3
LIGHTEST = 0.6  # of the way from black to white, of the surface's highest points


@dataclass(frozen=True, eq=False)
class ClassAnswer:
    """What came back for one class.

    Attributes:
        name: The class.
        grasps: Poses, best first, shape (G, 4, 4).
        widths: Jaw openings in [m], shape (G,).
        probability: That the first one affords the class, given that it holds.
        remark: Why there is none, or what came of trying the first one.
    """

    name: str
    grasps: FloatArray
    widths: FloatArray
    probability: float
    remark: str = ""


def class_colors(names: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Return a colour for each class, the same wherever the classes are the same."""
    table = colormaps["tab10"]
    return {name: tuple(table(i % table.N)) for i, name in enumerate(names)}


def draw_answers(
    depth: NDArray[np.float32],
    surface: FloatArray,
    answers: Sequence[ClassAnswer],
    gripper: Gripper,
    path: Path,
    title: str,
) -> None:
    """Write the picture: what the camera saw, then a panel for each class.

    Args:
        depth: Depth image in [m], shape (H, W), NaN = not measured.
        surface: Completed surface, shape (N, 3) in [m].
        answers: One per class, in the frame of the surface.
        gripper: The gripper.
        path: A ``.png`` file.
        title: Headline.
    """
    rows = -(-(len(answers) + 1) // COLUMNS)
    figure = Figure(figsize=(4.4 * COLUMNS, 4.2 * rows), dpi=DPI)
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=13)
    grid = figure.add_gridspec(rows, COLUMNS, wspace=0.04, hspace=0.14)
    draw_depth(figure.add_subplot(grid[0]), depth)
    colors = class_colors([answer.name for answer in answers])
    lower, edges = _around(surface)
    brightness = _brightness(surface)
    for place, answer in enumerate(answers, start=1):
        axes = figure.add_subplot(grid[place], projection="3d")
        draw_surface(
            axes, surface, c=brightness, cmap="Greys_r", vmin=0.0, vmax=1.0, s=6
        )
        color = colors[answer.name]
        rest = slice(1, SHOWN_GRASPS)
        draw_grippers(
            axes, answer.grasps[rest], answer.widths[rest], gripper,
            colors=color, linewidth=1.0,
        )  # fmt: skip
        draw_grippers(
            axes, answer.grasps[:1], answer.widths[:1], gripper,
            colors=color, linewidth=4.0,
        )  # fmt: skip
        frame_box(axes, lower, edges, _caption(answer), zoom=ZOOM)
        axes.title.set_color(color)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, bbox_inches="tight")


def _around(surface: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a box that holds a surface and hands above, in the surface's frame.

    Args:
        surface: Shape (N, 3) in [m].

    Returns:
        Lower corner and edges in [m], shape (3,) each.
    """
    if not len(surface):
        return np.zeros(3), np.full(3, LEAST_EDGE)
    lower, upper = surface.min(axis=0), surface.max(axis=0)
    width = max(LEAST_EDGE, float((upper - lower)[:2].max()))
    corner = (lower + upper - width) / 2
    corner[2] = lower[2]
    return corner, np.array([width, width, upper[2] - lower[2] + FOR_HANDS])


def _brightness(surface: FloatArray) -> FloatArray:
    """Return a grey for each point (N, 3): 0 (black) to ``LIGHTEST``, by height."""
    heights = surface[:, 2]
    if not len(heights):
        return heights
    low, high = heights.min(), heights.max()
    return LIGHTEST * (heights - low) / max(high - low, 1e-6)


def _caption(answer: ClassAnswer) -> str:
    if not len(answer.grasps):
        return f"{answer.name}: none\n{answer.remark}"
    text = f"{answer.name}: {answer.probability:.2f}, {len(answer.grasps)} grasps"
    return f"{text}\n{answer.remark}" if answer.remark else text
