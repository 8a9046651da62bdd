# SPDX-License-Identifier: Apache-2.0
"""Questions that several tests of objects ask."""

import numpy as np
from scipy.optimize import linprog


def _planes(mesh):
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    keep = lengths > 1e-14
    normals = normals[keep] / lengths[keep, None]
    planes = np.column_stack([normals, np.einsum("ij,ij->i", normals, a[keep])])
    return np.unique(planes.round(7), axis=0)


def _touch(one, other):
    """Tell whether two convex bodies share a point, or miss each other by < 0.1 mm."""
    for (planes, _), (_, vertices) in ((one, other), (other, one)):
        heights = vertices @ planes[:, :3].T - planes[:, 3]
        if (heights <= 1e-4).all(axis=1).any():
            return True
    planes = np.concatenate([one[0], other[0]])
    rows = np.column_stack([planes[:, :3], np.ones(len(planes))])
    result = linprog([0, 0, 0, -1], rows, planes[:, 3], bounds=[(None, None)] * 4)
    return -result.fun > -1e-4


def count_pieces(model):
    """Count the connected pieces of an object whose visuals are convex parts."""
    planes = [(_planes(mesh), mesh.vertices) for mesh in model.visuals]
    bounds = [mesh.bounds() for mesh in model.visuals]
    unseen, n_pieces = set(range(len(planes))), 0
    while unseen:
        n_pieces += 1
        queue = [unseen.pop()]
        while queue:
            current = queue.pop()
            for other in sorted(unseen):
                gap = np.maximum(
                    bounds[current][0] - bounds[other][1],
                    bounds[other][0] - bounds[current][1],
                ).max()
                if gap < 1e-4 and _touch(planes[current], planes[other]):
                    unseen.remove(other)
                    queue.append(other)
    return n_pieces
