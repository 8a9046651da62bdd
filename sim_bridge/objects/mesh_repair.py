# SPDX-License-Identifier: Apache-2.0
"""Tell whether meshes are closed, and close them where that is possible."""

import importlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.mesh import Mesh


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
    if is_watertight(repaired):
        return (outward(repaired),), "faces were turned or holes filled"
    return (whole,), "not closed"


def _repaired(mesh: Mesh) -> Mesh:
    trimesh = importlib.import_module("trimesh")
    repaired = trimesh.Trimesh(mesh.vertices, mesh.triangles, process=True)
    trimesh.repair.fix_winding(repaired)
    trimesh.repair.fill_holes(repaired)
    return weld(np.asarray(repaired.vertices), np.asarray(repaired.faces))
