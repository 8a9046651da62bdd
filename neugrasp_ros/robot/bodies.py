# SPDX-License-Identifier: Apache-2.0
"""The whole robot as plain arrays: its joint tree and the convex hulls it carries.

Pinocchio reads the URDF and finds the hulls; from then on, compiled code needs only
these arrays. Body frames have their joint's axis along local z, as in ``chain``.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from neugrasp_ros.robot.chain import turn_z_to
from neugrasp_ros.robot.model import RobotModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

SIDES = 20  # of the prism that stands for a cylinder; it is drawn around it


class JointTree(NamedTuple):
    """All joints of a configuration, parents first.

    Attributes:
        parents: Parent joint, -1 for the base, shape (J,).
        rotations: Constant rotation before each joint, shape (J, 3, 3).
        offsets: Constant translation before each joint in [m], shape (J, 3).
        prismatic: Which joints slide, shape (J,).
    """

    parents: IntArray
    rotations: FloatArray
    offsets: FloatArray
    prismatic: BoolArray


class Hulls(NamedTuple):
    """Convex hulls fixed to bodies; vertices and faces in the body frame.

    Attributes:
        bodies: Joint that carries each hull, -1 for the base, shape (G,).
        vertices: All vertices in [m], shape (V, 3).
        vertex_starts: Where each hull's begin, shape (G + 1,).
        faces: All outward planes (n, d) with n.x <= d inside, shape (F, 4).
        face_starts: Where each hull's begin, shape (G + 1,).
        centers: Centres of the bounding boxes in [m], shape (G, 3).
        axes: Axes of the bounding boxes as columns, shape (G, 3, 3).
        halves: Half extents of the bounding boxes in [m], shape (G, 3).
        radii: Radii of the bounding balls about ``centers`` in [m], shape (G,).
    """

    bodies: IntArray
    vertices: FloatArray
    vertex_starts: IntArray
    faces: FloatArray
    face_starts: IntArray
    centers: FloatArray
    axes: FloatArray
    halves: FloatArray
    radii: FloatArray


def joint_tree(robot: RobotModel) -> JointTree:
    """Return the joints of a robot as arrays."""
    model = robot.engine.model
    columns = joint_columns(robot)
    sliding = np.abs(columns[:, :3]).sum(axis=1) > 0.5
    turns = [
        turn_z_to(column[:3] if slides else column[3:])
        for column, slides in zip(columns, sliding, strict=True)
    ]
    parents = np.array(model.parents)[1:].astype(np.int64) - 1
    rotations, offsets = [], []
    for joint, parent in enumerate(parents):
        placement = model.jointPlacements[joint + 1]
        if parent < 0:
            before = robot.T_base_root
        else:
            before = np.eye(4)
            before[:3, :3] = turns[parent].T
        T = before @ placement.homogeneous
        rotations.append(T[:3, :3] @ turns[joint])
        offsets.append(T[:3, 3])
    return JointTree(parents, np.array(rotations), np.array(offsets), sliding)


def joint_columns(robot: RobotModel) -> FloatArray:
    """Return each joint's motion (linear, angular) in its own frame, shape (J, 6)."""
    model, data = robot.engine.model, robot.engine.data
    neutral = pin.neutral(model)
    return np.array(
        [
            pin.computeJointJacobian(model, data, neutral, j)[:, model.idx_vs[j]]
            for j in range(1, model.njoints)
        ]
    )


def robot_hulls(robot: RobotModel) -> tuple[Hulls, tuple[str, ...]]:
    """Return a robot's collision hulls, and the link that each belongs to."""
    columns = joint_columns(robot)
    items, links = [], []
    for item in robot.engine.geometry.geometryObjects:
        joint = item.parentJoint - 1
        T = item.placement.homogeneous
        if joint < 0:
            T = robot.T_base_root @ T
        else:
            slides = np.abs(columns[joint, :3]).sum() > 0.5
            axis = columns[joint, :3] if slides else columns[joint, 3:]
            T = _rotation(turn_z_to(axis).T) @ T
        items.append((joint, T, _outline(item.geometry)))
        links.append(robot.engine.model.frames[item.parentFrame].name)
    return pack_hulls(items), tuple(links)


def pack_hulls(items: Sequence[tuple[int, FloatArray, FloatArray]]) -> Hulls:
    """Pack hulls into arrays.

    Args:
        items: For each hull its body, its pose in the body frame (4, 4), and points
            whose hull it is, in its own frame in [m], shape (V, 3).
    """
    vertices, faces = [np.empty((0, 3))], [np.empty((0, 4))]
    boxes = []
    for _, T, outline in items:
        hull = ConvexHull(outline)
        corners = outline[hull.vertices]
        low, high = corners.min(axis=0), corners.max(axis=0)
        center = (low + high) / 2
        radius = np.linalg.norm(corners - center, axis=1).max()
        boxes.append((T[:3, :3] @ center + T[:3, 3], (high - low) / 2, radius))
        planes = np.unique(np.round(hull.equations, 12), axis=0)
        normals = planes[:, :3] @ T[:3, :3].T
        vertices.append(corners @ T[:3, :3].T + T[:3, 3])
        faces.append(np.column_stack([normals, normals @ T[:3, 3] - planes[:, 3]]))
    return Hulls(
        bodies=np.array([body for body, _, _ in items], dtype=np.int64),
        vertices=np.concatenate(vertices),
        vertex_starts=np.cumsum([len(v) for v in vertices]),
        faces=np.concatenate(faces),
        face_starts=np.cumsum([len(f) for f in faces]),
        centers=np.array([b[0] for b in boxes]).reshape(-1, 3),
        axes=np.array([T[:3, :3] for _, T, _ in items]).reshape(-1, 3, 3),
        halves=np.array([b[1] for b in boxes]).reshape(-1, 3),
        radii=np.array([b[2] for b in boxes]),
    )


def join_hulls(first: Hulls, second: Hulls) -> Hulls:
    """Return the hulls of both, in this order."""
    parts = {
        name: np.concatenate([getattr(first, name), getattr(second, name)])
        for name in Hulls._fields
        if not name.endswith("_starts")
    }
    for name, last in (("vertex_starts", first.vertices), ("face_starts", first.faces)):
        starts = getattr(second, name)[1:] + len(last)
        parts[name] = np.concatenate([getattr(first, name), starts])
    return Hulls(**parts)


def body_balls(hulls: Hulls, joints: int) -> FloatArray:
    """Return a ball around all hulls of each body, the base last.

    Returns:
        Centres in the body frame and radii in [m], shape (J + 1, 4); a body without
        hulls has radius zero.
    """
    balls = np.zeros((joints + 1, 4))
    for body in range(joints + 1):
        own = np.flatnonzero(hulls.bodies == (body if body < joints else -1))
        if not len(own):
            continue
        starts = hulls.vertex_starts
        points = np.concatenate(
            [hulls.vertices[starts[g] : starts[g + 1]] for g in own]
        )
        center = (points.min(axis=0) + points.max(axis=0)) / 2
        balls[body, :3] = center
        balls[body, 3] = np.linalg.norm(points - center, axis=1).max()
    return balls


def _rotation(matrix: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, :3] = matrix
    return T


def _outline(shape: Any) -> FloatArray:
    """Return points whose convex hull holds a collision shape, shape (V, 3)."""
    kind = type(shape).__name__
    if kind == "Box":
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        return np.asarray(signs * np.asarray(shape.halfSide))
    if kind in ("Cylinder", "Capsule"):
        half = shape.halfLength + (shape.radius if kind == "Capsule" else 0.0)
        turn = (np.arange(SIDES) + 0.5) * 2 * np.pi / SIDES
        outer = shape.radius / np.cos(np.pi / SIDES)
        ring = outer * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        caps = [np.column_stack([ring, np.full(SIDES, z)]) for z in (-half, half)]
        return np.concatenate(caps)
    if kind == "Sphere":
        golden = np.pi * (3 - np.sqrt(5.0)) * np.arange(60)
        z = 1 - (2 * np.arange(60) + 1) / 60
        ring = np.sqrt(1 - z * z)
        ball = np.stack([ring * np.cos(golden), ring * np.sin(golden), z], axis=1)
        inner = -ConvexHull(ball).equations[:, 3].max()
        return np.asarray(ball * shape.radius / inner)  # around it, not in it
    return np.array(shape.points())


@njit(cache=True, error_model="numpy")
def body_poses(tree, q, rotations, positions):  # type: ignore[no-untyped-def]
    """Write the pose of each body in the base frame.

    Args:
        tree: The joints.
        q: Configuration, shape (J,).
        rotations: Receives rotations, shape (J + 1, 3, 3); the last is the base.
        positions: Receives positions in [m], shape (J + 1, 3).
    """
    joints = q.shape[0]
    for i in range(3):
        positions[joints, i] = 0.0
        for j in range(3):
            rotations[joints, i, j] = 1.0 if i == j else 0.0
    for k in range(joints):
        move_body(tree, q[k], k, rotations, positions)


@njit(cache=True, error_model="numpy")
def move_body(tree, value, k, rotations, positions):  # type: ignore[no-untyped-def]
    """Write the pose of body ``k`` behind its parent's, as ``body_poses``.

    Args:
        tree: The joints.
        value: Of its joint in [rad] or [m].
        k: The body.
        rotations: Rotations so far, shape (J + 1, 3, 3).
        positions: Positions so far in [m], shape (J + 1, 3).
    """
    parent = tree.parents[k] if tree.parents[k] >= 0 else positions.shape[0] - 1
    steps, offsets, slides = tree.rotations, tree.offsets, tree.prismatic[k]
    x, y, z = offsets[k, 0], offsets[k, 1], offsets[k, 2]
    turn_c, turn_s = (1.0, 0.0) if slides else (np.cos(value), np.sin(value))
    for i in range(3):
        a = rotations[parent, i, 0]
        b = rotations[parent, i, 1]
        c = rotations[parent, i, 2]
        u = a * steps[k, 0, 0] + b * steps[k, 1, 0] + c * steps[k, 2, 0]
        v = a * steps[k, 0, 1] + b * steps[k, 1, 1] + c * steps[k, 2, 1]
        w = a * steps[k, 0, 2] + b * steps[k, 1, 2] + c * steps[k, 2, 2]
        rotations[k, i, 0] = turn_c * u + turn_s * v
        rotations[k, i, 1] = turn_c * v - turn_s * u
        rotations[k, i, 2] = w
        shift = value * w if slides else 0.0
        positions[k, i] = positions[parent, i] + a * x + b * y + c * z + shift
