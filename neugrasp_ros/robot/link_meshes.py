# SPDX-License-Identifier: Apache-2.0
"""What a robot looks like: one mesh for each body that moves, and where it is."""

from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from neugrasp_ros.geometry.mesh import Mesh
from neugrasp_ros.robot.bodies import body_poses, joint_tree, robot_hulls
from neugrasp_ros.robot.model import RobotModel

FloatArray = NDArray[np.float64]

STL_HEADER = 84  # [byte], of the binary form
STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("_", "<u2")])


class LinkMeshes:
    """The collision hulls of a robot as meshes.

    Args:
        robot: The robot.
        without: Joints whose bodies are left out, such as the one with the camera.

    Attributes:
        meshes: One for each body that has hulls, in its own frame.
    """

    def __init__(self, robot: RobotModel, without: tuple[str, ...] = ()) -> None:
        self._tree = joint_tree(robot)
        hulls, _ = robot_hulls(robot)
        count = len(robot.joint_names)
        hidden = {robot.joint_names.index(name) for name in without}
        parts: dict[int, list[FloatArray]] = {}
        for g, body in enumerate(hulls.bodies):
            vertices = hulls.vertices[
                hulls.vertex_starts[g] : hulls.vertex_starts[g + 1]
            ]
            if int(body) not in hidden:
                parts.setdefault(int(body) if body >= 0 else count, []).append(vertices)
        self._bodies = tuple(parts)
        self.meshes = tuple(_join([_hull(v) for v in parts[b]]) for b in self._bodies)

    def poses(self, q: FloatArray) -> FloatArray:
        """Return ``T_base_mesh`` of all meshes in a configuration (J,), (B, 4, 4)."""
        rotations, positions = _all_poses(self._tree, q)
        T = np.tile(np.eye(4), (len(self._bodies), 1, 1))
        for row, body in enumerate(self._bodies):
            T[row, :3, :3], T[row, :3, 3] = rotations[body], positions[body]
        return T


class VisualMeshes:
    """The parts that a robot shows, with their colours; loading takes a second.

    Args:
        robot: The robot.

    Attributes:
        meshes: Parts in their own frames.
        colors: Red, green, blue of each, 0..1, shape (B, 3).
    """

    def __init__(self, robot: RobotModel) -> None:
        self._robot = robot
        model = robot.engine.model
        full = pin.buildModelFromXML(robot.urdf)
        visual = pin.buildGeomFromUrdfString(full, robot.urdf, pin.GeometryType.VISUAL)
        locked = [
            full.getJointId(n) for n in full.names[1:] if not model.existJointName(n)
        ]
        _, self._geometry = pin.buildReducedModel(
            full, visual, locked, pin.neutral(full)
        )
        items = [
            (item, mesh)
            for item in self._geometry.geometryObjects
            if (mesh := _read(item)) is not None
        ]
        self.meshes = tuple(mesh for _, mesh in items)
        self._parents = [item.parentJoint for item, _ in items]
        self._placements = [item.placement.homogeneous.copy() for item, _ in items]
        self.colors = np.array([np.asarray(item.meshColor)[:3] for item, _ in items])

    def poses(self, q: FloatArray) -> FloatArray:
        """Return ``T_base_mesh`` of all parts in a configuration (J,), (B, 4, 4)."""
        robot, engine = self._robot, self._robot.engine
        data = engine.model.createData()
        pin.forwardKinematics(engine.model, data, robot.to_engine(q))
        return np.array(
            [
                robot.T_base_root @ data.oMi[parent].homogeneous @ placement
                for parent, placement in zip(
                    self._parents, self._placements, strict=True
                )
            ]
        )


def _all_poses(tree: object, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    count = len(q) + 1
    rotations, positions = np.empty((count, 3, 3)), np.empty((count, 3))
    body_poses(tree, np.asarray(q, dtype=np.float64), rotations, positions)
    return rotations, positions


def _hull(vertices: FloatArray) -> Mesh:
    """Return the hull of points with its faces turned outwards."""
    hull = ConvexHull(vertices)
    triangles = hull.simplices.copy()
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    triangles[inward] = triangles[inward][:, ::-1]
    return Mesh(vertices, triangles)


def _join(meshes: list[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    triangles = [m.triangles + s for m, s in zip(meshes, starts[:-1], strict=True)]
    return Mesh(np.concatenate([m.vertices for m in meshes]), np.concatenate(triangles))


def _read(item: pin.GeometryObject) -> Mesh | None:
    """Return the triangles of a drawn part, None where it is neither STL nor box."""
    if type(item.geometry).__name__ == "Box":
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        return _hull(signs * np.asarray(item.geometry.halfSide))
    path = Path(item.meshPath)
    if path.suffix.lower() != ".stl":
        return None
    facets = np.frombuffer(path.read_bytes()[STL_HEADER:], dtype=STL_FACET)
    corners = facets["corners"].reshape(-1, 3) * np.asarray(item.meshScale)
    return Mesh(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))
