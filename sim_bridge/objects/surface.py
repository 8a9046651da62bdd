# SPDX-License-Identifier: Apache-2.0
"""Draw points from the surface of an object, each knowing its part."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.mesh import Mesh
from sim_bridge.objects.model import ObjectModel

FloatArray = NDArray[np.float64]

SKIN = 1e-5  # a point this far outside its own part is tested against the others [m]
OVERSAMPLING = 1.3  # drawn at once, since some points lie inside another part


class SurfacePoints(NamedTuple):
    """Points on the outside of an object.

    Attributes:
        points: In the object's frame in [m], shape (N, 3).
        normals: Outward unit normals, shape (N, 3).
        part_index: Index of the mesh, and part, of each point, shape (N,).
    """

    points: FloatArray
    normals: FloatArray
    part_index: NDArray[np.int32]

    def take(self, mask: NDArray[np.bool_]) -> "SurfacePoints":
        """Return the points where the mask (N,) is true."""
        return SurfacePoints(
            self.points[mask], self.normals[mask], self.part_index[mask]
        )


class _HalfSpaces(NamedTuple):
    """Face planes of a convex mesh: it holds x where normals @ x <= offsets."""

    normals: FloatArray
    offsets: FloatArray
    lower: FloatArray
    upper: FloatArray


def sample_surface(
    model: ObjectModel, n: int, rng: np.random.Generator
) -> SurfacePoints:
    """Draw points uniformly from the outside of an object made of convex parts.

    Args:
        model: An object whose visuals are its parts, one mesh each.
        n: Number of points.
        rng: Source of randomness.

    Returns:
        Exactly ``n`` points, none inside another part.
    """
    sampler = _Sampler(model)
    kept: list[SurfacePoints] = []
    n_kept = 0
    while n_kept < n:
        kept.append(sampler.draw(int(OVERSAMPLING * (n - n_kept)) + 16, rng))
        n_kept += len(kept[-1].points)
    return SurfacePoints(
        np.concatenate([k.points for k in kept])[:n],
        np.concatenate([k.normals for k in kept])[:n],
        np.concatenate([k.part_index for k in kept])[:n],
    )


def sample_surface_evenly(
    model: ObjectModel, density: float, rng: np.random.Generator
) -> SurfacePoints:
    """Draw points from the outside of an object, so many per area.

    Args:
        model: An object whose visuals are its parts, one mesh each.
        density: Points per square metre of visible surface.
        rng: Source of randomness.
    """
    sampler = _Sampler(model)
    return sampler.draw(max(1, round(density * float(sampler.areas.sum()))), rng)


class _Sampler:
    """The triangles of an object and the half spaces of its parts."""

    def __init__(self, model: ObjectModel) -> None:
        """Collect them once for many draws."""
        corners = [mesh.vertices[mesh.triangles] for mesh in model.visuals]
        self.owner = np.repeat(np.arange(len(corners)), [len(c) for c in corners])
        self.triangles = np.concatenate(corners)  # (T, 3, 3)
        a, b, c = (self.triangles[:, i] for i in range(3))
        cross = np.cross(b - a, c - a)
        double_areas = np.linalg.norm(cross, axis=1)
        self.areas = double_areas / 2
        self.normals = cross / np.maximum(double_areas, 1e-15)[:, None]
        self.planes = [_half_spaces(mesh) for mesh in model.visuals]

    def draw(self, n: int, rng: np.random.Generator) -> SurfacePoints:
        """Draw ``n`` points and leave out those that another part covers."""
        share = self.areas / self.areas.sum()
        faces = rng.choice(len(share), size=n, p=share)
        points = _points_on(self.triangles[faces], rng)
        owner = self.owner[faces].astype(np.int32)
        drawn = SurfacePoints(points, self.normals[faces], owner)
        return drawn.take(~_is_covered(drawn, self.planes))


def _points_on(triangles: FloatArray, rng: np.random.Generator) -> FloatArray:
    u, v = rng.random((2, len(triangles), 1))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    a, b, c = (triangles[:, i] for i in range(3))
    return np.asarray(a + u * (b - a) + v * (c - a))


def _half_spaces(mesh: Mesh) -> _HalfSpaces:
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    proper = lengths > 1e-14
    normals = normals[proper] / lengths[proper, None]
    offsets = np.einsum("ij,ij->i", normals, a[proper])
    unique = np.unique(np.column_stack([normals, offsets]).round(9), axis=0)
    lower, upper = mesh.bounds()
    return _HalfSpaces(unique[:, :3], unique[:, 3], lower, upper)


def _is_covered(drawn: SurfacePoints, planes: list[_HalfSpaces]) -> NDArray[np.bool_]:
    """Tell which points lie inside, or flush against, a part that is not their own."""
    covered = np.zeros(len(drawn.points), dtype=bool)
    lifted = drawn.points + SKIN * drawn.normals
    for index, part in enumerate(planes):
        near = ((lifted >= part.lower) & (lifted <= part.upper)).all(axis=1)
        near &= ~covered & (drawn.part_index != index)
        if near.any():
            heights = lifted[near] @ part.normals.T - part.offsets
            covered[near] = (heights <= 0).all(axis=1)
    return covered
