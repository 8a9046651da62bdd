# SPDX-License-Identifier: Apache-2.0
"""Tell whether meshes are closed, and close them where that is possible."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.mesh import Mesh

LARGEST_PATCH = 0.25  # of the area: beyond that a filled hole is an invented shape


def weld(vertices: NDArray[np.float64], triangles: NDArray[np.int_]) -> Mesh:
    """Make one vertex of those at the same place, and drop faces that collapse.

    Args:
        vertices: Shape (V, 3).
        triangles: Shape (T, 3).
    """
    unique, inverse = np.unique(vertices, axis=0, return_inverse=True)
    faces = inverse.reshape(-1)[triangles]
    proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return Mesh(unique, faces[proper])


def merge_meshes(meshes: Sequence[Mesh]) -> Mesh:
    """Join meshes into one; vertices at the same place become one vertex."""
    offsets = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    triangles = np.concatenate(
        [mesh.triangles + offset for mesh, offset in zip(meshes, offsets, strict=False)]
    )
    return weld(vertices, triangles)


def is_watertight(mesh: Mesh) -> bool:
    """Tell whether every edge is met by a neighbour that runs the other way."""
    start = mesh.triangles[:, [0, 1, 2]].ravel().astype(np.int64)
    end = mesh.triangles[:, [1, 2, 0]].ravel().astype(np.int64)
    n = len(mesh.vertices)
    forward, backward = np.sort(start * n + end), np.sort(end * n + start)
    return len(forward) > 0 and bool(np.array_equal(forward, backward))


def outward(mesh: Mesh) -> Mesh:
    """Return the mesh with faces turned if it encloses a negative volume."""
    return mesh if mesh.volume() >= 0 else Mesh(mesh.vertices, mesh.triangles[:, ::-1])


def surface_area(mesh: Mesh) -> float:
    """Return the area of all faces in [m^2]."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def close_meshes(groups: Sequence[Mesh]) -> tuple[tuple[Mesh, ...], str]:
    """Return closed, outward meshes of the same shape, as far as possible.

    Groups that are closed stay apart. Else all are joined and welded; if that is not
    enough, faces are turned to agree and holes filled.

    Args:
        groups: Meshes of one object.

    Returns:
        The meshes, and a note that says what was changed; empty if nothing was. The
        caller checks :func:`is_watertight`: a mesh may be beyond repair.
    """
    if all(is_watertight(group) for group in groups):
        return tuple(outward(group) for group in groups), ""
    whole = merge_meshes(groups)
    if is_watertight(whole):
        return (outward(whole),), ""
    repaired = _repaired(whole)
    patched = surface_area(repaired) - surface_area(whole)
    if is_watertight(repaired) and patched < LARGEST_PATCH * surface_area(whole):
        return (outward(repaired),), "faces were turned or holes filled"
    return (whole,), "not closed"


def _repaired(mesh: Mesh) -> Mesh:
    return _holes_filled(Mesh(mesh.vertices, _agreeing_faces(mesh.triangles)))


def _directed_edges(triangle: NDArray[np.int32]) -> list[tuple[int, int]]:
    a, b, c = (int(corner) for corner in triangle)
    return [(a, b), (b, c), (c, a)]


def _agreeing_faces(triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Turn faces until neighbours run along their common edge in opposite ways."""
    owners: dict[tuple[int, int], list[int]] = {}
    for index, triangle in enumerate(triangles):
        for a, b in _directed_edges(triangle):
            owners.setdefault((min(a, b), max(a, b)), []).append(index)
    faces = triangles.copy()
    unseen = set(range(len(faces)))
    while unseen:
        queue = [unseen.pop()]
        while queue:
            current = queue.pop()
            for a, b in _directed_edges(faces[current]):
                for other in owners[min(a, b), max(a, b)]:
                    if other not in unseen:
                        continue
                    unseen.remove(other)
                    queue.append(other)
                    if (a, b) in _directed_edges(faces[other]):
                        faces[other] = faces[other][::-1]
    return faces


def _holes_filled(mesh: Mesh) -> Mesh:
    """Close every simple loop of open edges with a fan about its middle."""
    edges = {edge for triangle in mesh.triangles for edge in _directed_edges(triangle)}
    following = {b: a for a, b in edges if (b, a) not in edges}
    vertices, faces = [mesh.vertices], [mesh.triangles]
    n_vertices = len(mesh.vertices)
    while following:
        start, corner = following.popitem()
        loop = [start]
        while corner in following:
            loop.append(corner)
            corner = following.pop(corner)
        if corner != start:
            continue  # open edges that meet in a tangle
        middle = np.full(len(loop), n_vertices)
        vertices.append(mesh.vertices[loop].mean(axis=0, keepdims=True))
        faces.append(
            np.column_stack([loop, np.roll(loop, -1), middle]).astype(np.int32)
        )
        n_vertices += 1
    return Mesh(np.concatenate(vertices), np.concatenate(faces))
