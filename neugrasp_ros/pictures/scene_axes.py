# SPDX-License-Identifier: Apache-2.0
"""Three-dimensional axes with point clouds and grippers."""

from typing import Any

import numpy as np
from matplotlib import colormaps
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import apply

FloatArray = NDArray[np.float64]

QUALITY_COLORS = colormaps["RdYlGn"]
SURFACE_COLORS = colormaps["viridis"]
STEM = 0.04  # [m], length drawn of the hand behind the palm


def gripper_lines(widths: FloatArray, gripper: Gripper) -> FloatArray:
    """Draw hands as four strokes each: stem, palm, two fingers.

    Args:
        widths: Jaw openings in [m], shape (G,).
        gripper: The gripper.

    Returns:
        End points in the gripper frame in [m], shape (G, 4, 2, 3).
    """
    palm = -gripper.finger_depth
    lines = np.zeros((len(widths), 4, 2, 3))
    half = np.asarray(widths)[:, None] / 2
    lines[:, 0, :, 2] = palm - STEM, palm
    lines[:, 1, :, 2] = palm
    lines[:, 1, :, 1] = np.concatenate([-half, half], axis=1)
    for stroke, side in ((2, -1.0), (3, 1.0)):
        lines[:, stroke, :, 1] = side * half
        lines[:, stroke, :, 2] = palm, 0.0
    return lines


def draw_grippers(
    axes: Any,
    T_scene_grippers: FloatArray,
    widths: FloatArray,
    gripper: Gripper,
    *,
    colors: Any,
    linewidth: float = 1.0,
) -> None:
    """Add hands to three-dimensional axes.

    Args:
        axes: Matplotlib axes with a 3d projection.
        T_scene_grippers: Poses in the frame of the axes, shape (G, 4, 4).
        widths: Jaw openings in [m], shape (G,).
        gripper: The gripper.
        colors: One colour, or one per hand.
        linewidth: In [pt].
    """
    if not len(T_scene_grippers):
        return
    lines = gripper_lines(widths, gripper)
    ends = apply(T_scene_grippers, lines.reshape(len(lines), 8, 3))
    strokes = ends.reshape(-1, 2, 3)
    each = np.repeat(colors, 4, axis=0) if np.ndim(colors) == 2 else colors
    axes.add_collection3d(Line3DCollection(strokes, colors=each, linewidths=linewidth))


def draw_surface(axes: Any, points: FloatArray, **style: Any) -> None:
    """Add a point cloud (N, 3) in [m], coloured by height unless told otherwise."""
    if not len(points):
        return
    style.setdefault("c", points[:, 2])
    style.setdefault("cmap", SURFACE_COLORS)
    style.setdefault("s", 3)
    axes.scatter(*points.T, linewidths=0, depthshade=False, **style)


def frame_cube(axes: Any, lower: FloatArray, edge: float, title: str) -> None:
    """Fit axes to a cube, hide their decoration, and look down from the side."""
    frame_box(axes, lower, np.full(3, edge), title, zoom=1.45)


def frame_box(
    axes: Any, lower: FloatArray, edges: FloatArray, title: str, *, zoom: float
) -> None:
    """Fit axes to a box, hide their decoration, and look down from the side.

    Args:
        axes: Matplotlib axes with a 3d projection.
        lower: Lower corner in the frame of the axes in [m], shape (3,).
        edges: In [m], shape (3,).
        title: Above the box.
        zoom: Of the picture within the axes.
    """
    for axis, low, edge in zip("xyz", lower, edges, strict=True):
        getattr(axes, f"set_{axis}lim")(low, low + edge)
    axes.set_box_aspect(tuple(edges / edges.max()), zoom=zoom)
    axes.view_init(elev=35, azim=-150)
    axes.set_axis_off()
    axes.set_title(title, fontsize=10)
