# SPDX-License-Identifier: Apache-2.0
"""Ray casting against meshes; the only user of Open3D's ray-casting scene."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ShapeError
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.mesh import Mesh
from neugrasp_ros.geometry.open3d_engine import o3d

FloatArray = NDArray[np.float64]


class RayHits(NamedTuple):
    """What rays met.

    Attributes:
        distances: Along each ray in units of its direction, shape (R,); inf = nothing.
        normals: Unit normals towards the side that the ray came from, shape (R, 3).
        bodies: Body id of the mesh that was hit, shape (R,); -1 = nothing.
    """

    distances: NDArray[np.float32]
    normals: NDArray[np.float32]
    bodies: NDArray[np.int32]


def _tensor(array: NDArray[Any]) -> o3d.core.Tensor:
    return o3d.core.Tensor(array)  # type: ignore[call-overload,no-any-return]


@lru_cache(maxsize=16)
def _camera_rays(intrinsics: Intrinsics) -> NDArray[np.float32]:
    return intrinsics.ray_directions().reshape(-1, 3).astype(np.float32)


class MeshScene:
    """Posed meshes that can be looked at and asked for what they contain.

    Args:
        meshes: Closed meshes, each in its own frame.
        poses: Poses ``T_scene_mesh``, shape (B, 4, 4).
        body_ids: Body of each mesh; several meshes may make one body. Default 0..B-1.

    Raises:
        ShapeError: If there is not one pose, and one body id, for each mesh.
    """

    def __init__(
        self,
        meshes: Sequence[Mesh],
        poses: FloatArray,
        body_ids: Sequence[int] | None = None,
    ) -> None:
        poses, n = np.asarray(poses, dtype=np.float64), len(meshes)
        if poses.shape != (n, 4, 4) and (n or poses.size):
            raise ShapeError("poses", f"({n}, 4, 4)", poses.shape)
        ids = range(n) if body_ids is None else body_ids
        if len(ids) != n:
            raise ShapeError("body_ids", f"({n},)", (len(ids),))
        self._meshes = tuple(
            m.transformed(p) for m, p in zip(meshes, poses, strict=True)
        )
        self._ids = np.asarray([*ids, -1], dtype=np.int32)
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        for mesh in self._meshes:
            self._add(self._scene, mesh)

    @staticmethod
    def _add(scene: o3d.t.geometry.RaycastingScene, mesh: Mesh) -> int:
        return int(
            scene.add_triangles(
                _tensor(mesh.vertices.astype(np.float32)),
                _tensor(mesh.triangles.astype(np.uint32)),
            )
        )

    def cast(self, origins: FloatArray, directions: FloatArray) -> RayHits:
        """Cast rays given in the scene frame.

        Args:
            origins: Ray origins in [m], shape (R, 3).
            directions: Ray directions of any length, shape (R, 3).
        """
        rays = np.concatenate([origins, directions], axis=1).astype(np.float32)
        result = self._scene.cast_rays(_tensor(rays), nthreads=1)
        geometry = result["geometry_ids"].numpy().astype(np.int64)
        bodies = self._ids[np.minimum(geometry, len(self._ids) - 1)]
        normals = result["primitive_normals"].numpy()
        away = np.einsum("ij,ij->i", normals, rays[:, 3:]) > 0
        normals = np.where(away[:, None], -normals, normals)
        return RayHits(result["t_hit"].numpy(), normals, bodies)

    def view(self, intrinsics: Intrinsics, T_scene_camera: FloatArray) -> RayHits:
        """Cast the rays of all pixels; distances are depths along the optical axis.

        Returns:
            Hits with normals in the scene frame, pixel (v, u) at row ``v * W + u``.
        """
        directions = _camera_rays(intrinsics) @ T_scene_camera[:3, :3].T
        origins = np.broadcast_to(T_scene_camera[:3, 3], directions.shape)
        return self.cast(origins, directions)

    def depth(
        self, intrinsics: Intrinsics, T_scene_camera: FloatArray
    ) -> NDArray[np.float32]:
        """Render a depth image in [m], shape (H, W); NaN where nothing is hit."""
        distances = self.view(intrinsics, T_scene_camera).distances
        depth = np.where(np.isfinite(distances), distances, np.nan)
        return depth.reshape(intrinsics.height, intrinsics.width).astype(np.float32)

    def segmentation(
        self, intrinsics: Intrinsics, T_scene_camera: FloatArray
    ) -> NDArray[np.int32]:
        """Render the body id of every pixel, shape (H, W); -1 where nothing is hit."""
        bodies = self.view(intrinsics, T_scene_camera).bodies
        return bodies.reshape(intrinsics.height, intrinsics.width)

    def contains(self, points: FloatArray) -> NDArray[np.bool_]:
        """Tell which points of shape (N, 3) lie inside any of the meshes.

        Each mesh is tested by ray parity inside its bounding box, so overlapping
        meshes are a union.
        """
        points = np.asarray(points, dtype=np.float64)
        inside = np.zeros(len(points), dtype=bool)
        for index in range(len(self._meshes)):
            lower, upper = self._meshes[index].bounds()
            near = ((points >= lower) & (points <= upper)).all(axis=1) & ~inside
            if near.any():
                inside[near] = self._contained_in(index, points[near])
        return inside

    def _contained_in(self, index: int, points: FloatArray) -> NDArray[np.bool_]:
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._add(scene, self._meshes[index])
        query = _tensor(points.astype(np.float32))
        occupied = scene.compute_occupancy(query, nthreads=1, nsamples=3).numpy()
        return np.asarray(occupied > 0.5)

    def sample_surface(
        self, n_points: int, rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, NDArray[np.int32]]:
        """Draw points uniformly from the outside of the union of the meshes.

        Args:
            n_points: How many to draw; points inside another mesh are dropped, so
                fewer may come back, and none from an empty scene.
            rng: Source of randomness.

        Returns:
            Points in [m] (N, 3), outward unit normals (N, 3), and body ids (N,).
        """
        if not self._meshes:
            none = np.zeros((0, 3))
            return none, none, self._ids[:0]
        corners = np.concatenate([m.vertices[m.triangles] for m in self._meshes])
        counts = [len(m.triangles) for m in self._meshes]
        owner = np.repeat(np.arange(len(counts)), counts)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(normals, axis=1)
        chosen = rng.choice(len(areas), size=n_points, p=areas / areas.sum())
        u, v = rng.random((2, n_points, 1))
        over = u + v > 1
        u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
        a, b, c = (corners[chosen, i] for i in range(3))
        points = a + u * (b - a) + v * (c - a)
        normals = normals[chosen] / np.maximum(areas[chosen], 1e-12)[:, None]
        outside = ~self.contains(points + 1e-5 * normals)
        bodies = self._ids[owner[chosen]]
        return points[outside], normals[outside], bodies[outside]
