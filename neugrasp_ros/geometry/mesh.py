# SPDX-License-Identifier: Apache-2.0
"""Triangle meshes as values."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.transform import apply


@dataclass(frozen=True, eq=False, slots=True)
class Mesh:
    """A closed triangle mesh with outward (counter-clockwise) faces.

    Attributes:
        vertices: Vertices in the mesh's own frame in [m], shape (V, 3).
        triangles: Indices into the vertices, shape (T, 3).
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]

    def __post_init__(self) -> None:
        """Check the shapes and make the arrays read-only copies.

        Raises:
            ShapeError: If an array is not (_, 3).
        """
        for name, dtype in (("vertices", np.float64), ("triangles", np.int32)):
            array = np.array(getattr(self, name), dtype=dtype)
            if array.ndim != 2 or array.shape[1] != 3:
                raise ShapeError(name, "(_, 3)", array.shape)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def scaled(self, factor: float) -> "Mesh":
        """Return the mesh with all vertices multiplied by ``factor``."""
        return Mesh(self.vertices * factor, self.triangles)

    def transformed(self, T_a_mesh: NDArray[np.float64]) -> "Mesh":
        """Return the mesh with its vertices expressed in frame a."""
        return Mesh(apply(T_a_mesh, self.vertices), self.triangles)

    def bounds(self) -> NDArray[np.float64]:
        """Return the lower and upper corner in [m], shape (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    def volume(self) -> float:
        """Return the enclosed volume in [m^3] by the divergence theorem."""
        a, b, c = (self.vertices[self.triangles[:, i]] for i in range(3))
        return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def box_mesh(half_extents: NDArray[np.float64]) -> Mesh:
    """Return an axis-aligned box about the origin; half extents (3,) in [m]."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)])
    faces = [
        (0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4),
        (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5),
    ]  # fmt: skip
    triangles = [t for a, b, c, d in faces for t in ((a, b, c), (a, c, d))]
    return Mesh((2.0 * corners - 1.0) * np.asarray(half_extents), np.array(triangles))
