# SPDX-License-Identifier: Apache-2.0
"""Closed triangle meshes and volumes of the convex part kinds."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from neugrasp_ros.errors import ObjectFileError
from neugrasp_ros.geometry.mesh import Mesh, box_mesh

FloatArray = NDArray[np.float64]

N_SIDES = 32  # of a tessellated circle: the chord error is 0.5 % of the radius
N_CAP_RINGS = 8  # latitude rings of half a sphere


def revolved_mesh(
    radii: FloatArray, heights: FloatArray, n_sides: int = N_SIDES
) -> Mesh:
    """Revolve a profile about z and close it with a pole at either end.

    Args:
        radii: Positive radii of the rings in [m], shape (R,), lowest ring first.
        heights: Their z in [m], shape (R,). The poles lie on the axis at the first
            and the last height, or beyond them where a radius of 0 is given.
        n_sides: Corners of each ring.

    Returns:
        A closed mesh with outward faces.
    """
    angles = np.arange(n_sides) * (2 * np.pi / n_sides)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    on_axis = np.asarray(radii) <= 0
    poles = np.asarray(heights, dtype=np.float64)[[0, -1]]
    rings, levels = np.asarray(radii)[~on_axis], np.asarray(heights)[~on_axis]
    vertices = [
        np.column_stack([r * circle, np.full(n_sides, z)])
        for r, z in zip(rings, levels, strict=True)
    ]
    vertices.append(np.array([[0, 0, poles[0]], [0, 0, poles[1]]]))
    a = np.arange(n_sides)
    b = (a + 1) % n_sides
    bottom = len(rings) * n_sides
    last = bottom - n_sides
    faces = [np.column_stack([b, a, np.full(n_sides, bottom)])]
    for start in range(0, last, n_sides):
        p, q = start + a, start + b
        faces += [
            np.column_stack([p, q, q + n_sides]),
            np.column_stack([p, q + n_sides, p + n_sides]),
        ]
    faces.append(np.column_stack([last + a, last + b, np.full(n_sides, bottom + 1)]))
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def hull_mesh(points: FloatArray) -> Mesh:
    """Return the convex hull of points (V, 3) as a closed mesh.

    Raises:
        ObjectFileError: If the points do not span a volume.
    """
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        reason = f"{len(points)} points do not span a convex volume"
        raise ObjectFileError("convex part", reason) from error
    lookup = np.full(len(points), -1)
    lookup[hull.vertices] = np.arange(len(hull.vertices))
    triangles = hull.simplices.copy()
    corners = hull.points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return Mesh(hull.points[hull.vertices], lookup[triangles])


@lru_cache(maxsize=512)
def primitive_mesh(kind: str, size: tuple[float, ...]) -> Mesh:
    """Tessellate a box, cylinder, sphere or capsule about its own frame.

    Args:
        kind: ``box``, ``cylinder``, ``sphere`` or ``capsule``.
        size: As in :class:`sim_bridge.objects.model.Part`.
    """
    if kind == "box":
        return box_mesh(np.array(size))
    if kind == "cylinder":
        radius, length = size
        return revolved_mesh(np.full(2, radius), np.array([-0.5, 0.5]) * length)
    radius, length = size[0], size[1] if kind == "capsule" else 0.0
    latitudes = np.linspace(0, np.pi / 2, N_CAP_RINGS + 1)
    first = 0 if kind == "capsule" else 1  # a sphere has one equator
    radii = np.concatenate([np.cos(latitudes)[::-1], np.cos(latitudes)[first:]])
    upper, lower = np.sin(latitudes)[first:], -np.sin(latitudes)[::-1]
    heights = np.concatenate([radius * lower - length / 2, radius * upper + length / 2])
    radii[[0, -1]] = 0.0
    return revolved_mesh(radius * radii, heights)


def primitive_volume(kind: str, size: tuple[float, ...]) -> float:
    """Return the exact volume of a box, cylinder, sphere or capsule in [m^3]."""
    if kind == "box":
        return 8.0 * size[0] * size[1] * size[2]
    if kind == "cylinder":
        return float(np.pi) * size[0] ** 2 * size[1]
    ball = 4.0 / 3.0 * float(np.pi) * size[0] ** 3
    return ball if kind == "sphere" else ball + float(np.pi) * size[0] ** 2 * size[1]
