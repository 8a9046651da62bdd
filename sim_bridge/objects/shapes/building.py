# SPDX-License-Identifier: Apache-2.0
"""Convex building blocks: boxes, rods, lofts, walls, swept bars, sheets."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp_ros.geometry.transform import make_transform
from sim_bridge.objects.model import Part

FloatArray = NDArray[np.float64]
Point = Sequence[float] | FloatArray
Section = tuple[float, float, float]  # height z, half width x, half depth y [m]

N_ROUND = 20  # corners of a round loft
N_WALL = 12  # wedges of a round wall


def box(size: Point, at: Point = (0, 0, 0), label: str = "", yaw: float = 0.0) -> Part:
    """Return a box of full edge lengths ``size``, centred at ``at``, turned about z."""
    rotation = Rotation.from_euler("z", yaw).as_matrix()
    half = tuple(0.5 * edge for edge in size)
    return Part("box", half, make_transform(rotation, np.array(at)), label)


def cylinder(
    radius: float, length: float, at: Point, axis: str = "z", label: str = ""
) -> Part:
    """Return a cylinder centred at ``at`` along the named axis."""
    angles = {"z": (0.0, 0.0), "x": (0.0, np.pi / 2), "y": (np.pi / 2, 0.0)}[axis]
    rotation = Rotation.from_euler("xy", angles).as_matrix()
    return Part(
        "cylinder", (radius, length), make_transform(rotation, np.array(at)), label
    )


def sphere(radius: float, at: Point, label: str = "") -> Part:
    """Return a ball centred at ``at``."""
    return Part("sphere", (radius,), make_transform(np.eye(3), np.array(at)), label)


def rod(start: Point, end: Point, radius: float, label: str = "") -> Part:
    """Return a capsule whose cap centres are ``start`` and ``end``."""
    a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(z, x), z])
    return Part(
        "capsule", (radius, length), make_transform(rotation, (a + b) / 2), label
    )


def hull(points: FloatArray, label: str = "") -> Part:
    """Return the convex hull of points of shape (V, 3)."""
    return Part("hull", (), np.eye(4), label, np.asarray(points, dtype=np.float64))


def disc(z: float, radius: float) -> Section:
    """Return the section of a circle at height ``z``."""
    return z, radius, radius


def ring(
    section: Section, squareness: float = 2.0, n_sides: int = N_ROUND
) -> FloatArray:
    """Return the corners of a horizontal superellipse, shape (n_sides, 3).

    Args:
        section: Height and half widths in [m].
        squareness: Exponent; 2 is an ellipse, 8 nearly a rectangle.
        n_sides: Number of corners.
    """
    z, half_x, half_y = section
    angles = (np.arange(n_sides) + 0.5) * (2 * np.pi / n_sides)
    c, s = np.cos(angles), np.sin(angles)
    radius = (np.abs(c) ** squareness + np.abs(s) ** squareness) ** (-1 / squareness)
    return np.column_stack(
        [half_x * radius * c, half_y * radius * s, np.full(n_sides, z)]
    )


def loft(sections: Iterable[Section], label: str = "", squareness: float = 2.0) -> Part:
    """Return the convex hull of horizontal superellipses, such as a bottle's body."""
    return hull(np.concatenate([ring(s, squareness) for s in sections]), label)


def wall(
    inner: Sequence[Section],
    outer: Sequence[Section],
    label: str = "",
    arc: tuple[float, float] = (0.0, 2 * np.pi),
    n_wedges: int = N_WALL,
) -> list[Part]:
    """Return a round wall as wedges between an inner and an outer profile.

    Args:
        inner: Sections of the inside, lowest first.
        outer: Sections of the outside, as many.
        label: Label of every wedge.
        arc: First and last angle about z; the whole turn by default.
        n_wedges: Wedges per pair of sections over the arc.
    """
    edges = np.linspace(*arc, n_wedges + 1)
    corner = np.stack([np.cos(edges), np.sin(edges)], axis=1)  # (n_wedges + 1, 2)

    def points(section: Section, k: int) -> FloatArray:
        z, half_x, half_y = section
        xy = corner[[k, k + 1]] * (half_x, half_y)
        return np.column_stack([xy, [z, z]])

    return [
        hull(np.concatenate([points(s, k) for s in sections]), label)
        for j in range(len(outer) - 1)
        for sections in [(*inner[j : j + 2], *outer[j : j + 2])]
        for k in range(n_wedges)
    ]


def cup(
    sections: Sequence[Section],
    thickness: float,
    label: str = "",
    n_wedges: int = N_WALL,
) -> list[Part]:
    """Return a floor and a round wall whose outside follows the sections.

    Args:
        sections: Outside, lowest first; the first is the underside.
        thickness: Of wall and floor in [m].
        label: Label of every part.
        n_wedges: Wedges per pair of sections.
    """
    z, half_x, half_y = sections[0]
    floor = hull(
        np.concatenate(
            [ring((h, half_x, half_y), n_sides=n_wedges) for h in (z, z + thickness)]
        ),
        label,
    )
    inner = [(s[0], s[1] - thickness, s[2] - thickness) for s in sections]
    return [floor, *wall(inner, sections, label, n_wedges=n_wedges)]


def sweep(
    path: FloatArray,
    size: tuple[float, float],
    side: Point,
    label: str = "",
    round_section: bool = False,
) -> list[Part]:
    """Return a bar that follows a path, mitred at the corners.

    Args:
        path: Points along its middle in [m], shape (K, 3).
        size: Full width along ``side`` and full thickness across it in [m].
        side: Direction of the width; never along the path.
        label: Label of every segment.
        round_section: Whether the cross section is an ellipse instead of a rectangle.
    """
    path = np.asarray(path, dtype=np.float64)
    steps = np.diff(path, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    tangents = np.concatenate([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.cross(tangents, np.asarray(side, dtype=np.float64))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(across, tangents)
    stretch = np.ones(len(path))  # a mitre is longer than the bar is thick
    stretch[1:-1] = 1.0 / np.clip(
        np.einsum("ij,ij->i", tangents[1:-1], steps[1:]), 0.5, 1
    )
    corners = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]], dtype=np.float64)
    if round_section:
        angles = np.arange(8) * (np.pi / 4) + np.pi / 8
        corners = np.stack([np.cos(angles), np.sin(angles)], axis=1) / np.cos(np.pi / 8)
    rings = path[:, None] + (
        corners[None, :, :1] * along[:, None] * (size[0] / 2)
        + corners[None, :, 1:]
        * across[:, None]
        * (stretch * size[1] / 2)[:, None, None]
    )
    return [hull(rings[k : k + 2].reshape(-1, 3), label) for k in range(len(path) - 1)]


def arc_path(
    center: Point, radii: tuple[float, float], angles: tuple[float, float], n: int,
    plane: str = "xz",
) -> FloatArray:  # fmt: skip
    """Return points on an ellipse arc in a coordinate plane, shape (n + 1, 3).

    Args:
        center: Centre of the ellipse in [m].
        radii: Radii along the plane's first and second axis in [m].
        angles: First and last angle, from the first axis to the second, in [rad].
        n: Number of segments.
        plane: ``xy``, ``xz`` or ``yz``.
    """
    turn = np.linspace(*angles, n + 1)
    points = np.tile(np.asarray(center, dtype=np.float64), (n + 1, 1))
    first, second = ("xyz".index(axis) for axis in plane)
    points[:, first] += radii[0] * np.cos(turn)
    points[:, second] += radii[1] * np.sin(turn)
    return points


def sheet(
    outline: Sequence[Point] | FloatArray,
    thickness: float,
    label: str = "",
    z: float = 0.0,
) -> Part:
    """Return a flat convex plate: an outline (K, 2) in xy, centred on height z."""
    xy = np.asarray(outline, dtype=np.float64)
    levels = [np.full(len(xy), z + side * thickness / 2) for side in (-1, 1)]
    return hull(np.concatenate([np.column_stack([xy, h]) for h in levels]), label)


def ellipsoid(radii: Point, at: Point = (0, 0, 0), label: str = "") -> Part:
    """Return an ellipsoid as a hull of rings."""
    latitudes = np.linspace(-np.pi / 2, np.pi / 2, 9)
    circle = ring((0.0, 1.0, 1.0), n_sides=16)[:, :2]
    points = np.concatenate(
        [
            np.column_stack([np.cos(t) * circle, np.full(16, np.sin(t))])
            for t in latitudes
        ]
    )
    return hull(np.unique(points.round(12), axis=0) * radii + np.asarray(at), label)


def moved(
    parts: Iterable[Part],
    by: Point = (0, 0, 0),
    euler: Point = (0, 0, 0),
    label: str | None = None,
) -> list[Part]:
    """Return parts turned by fixed-axis angles xyz in [rad], then shifted by ``by``."""
    motion = make_transform(
        Rotation.from_euler("xyz", np.asarray(euler, dtype=float)).as_matrix(),
        np.asarray(by, dtype=float),
    )
    return [
        replace(
            part, pose=motion @ part.pose, label=part.label if label is None else label
        )
        for part in parts
    ]


def mirrored(parts: Iterable[Part]) -> list[Part]:
    """Return hull and symmetric parts mirrored in x; labels stay."""
    flip = np.diag([-1.0, 1.0, 1.0, 1.0])
    keep = np.diag([-1.0, 1.0, 1.0])
    return [
        replace(
            part,
            pose=flip @ part.pose @ flip,
            vertices=None if part.vertices is None else part.vertices @ keep,
        )
        for part in parts
    ]
