# SPDX-License-Identifier: Apache-2.0
"""Where messages and library values meet: grasps, volumes, poses."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseArray, PoseStamped, Quaternion
from neugrasp_msgs.msg import Grasp, GraspArray
from neugrasp_msgs.msg import TsdfVolume as TsdfMessage
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, ShapeError
from neugrasp_ros.fusion.tsdf import TsdfVolume
from neugrasp_ros.geometry.transform import pose_from, to_position_quaternion
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.nodes.compat.images import to_bytes
from neugrasp_ros.nodes.frames import from_axes, to_axes
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList, Reach
from neugrasp_ros.nodes.scene_view import SceneView

FloatArray = NDArray[np.float64]

NANOSECONDS = 10**9
LEAST_NORM = 0.5  # of a quaternion that is meant as one
NONE = np.zeros((0, 3))  # contacts that are not known


def to_stamp(nanoseconds: int) -> Time:
    """Return a time in [ns] as a message."""
    sec, nanosec = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=sec, nanosec=nanosec)


def from_stamp(stamp: Time) -> int:
    """Return a stamp in [ns]."""
    return int(stamp.sec * NANOSECONDS + stamp.nanosec)


def only(grasps: GraspArray, grasp: Grasp) -> GraspArray:
    """Return an array with one of its grasps, and what is said of all of them."""
    return GraspArray(
        header=grasps.header,
        axes=grasps.axes,
        stage=grasps.stage,
        gripper=grasps.gripper,
        tcp_frame=grasps.tcp_frame,
        scene_revision=grasps.scene_revision,
        joint_names=grasps.joint_names,
        grasps=[grasp],
    )


def to_poses(T_a_bs: FloatArray) -> list[Pose]:
    """Return poses of shape (N, 4, 4) as messages."""
    if not len(T_a_bs):
        return []
    positions, quaternions = to_position_quaternion(T_a_bs)
    return [
        Pose(
            position=Point(x=p[0], y=p[1], z=p[2]),
            orientation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]),
        )
        for p, q in zip(positions.tolist(), quaternions.tolist(), strict=True)
    ]


def to_pose(T_a_b: FloatArray) -> Pose:
    """Return a pose of shape (4, 4) as a message."""
    return to_poses(T_a_b[None])[0]


def from_poses(poses: list[Pose], what: str = "pose") -> FloatArray:
    """Return poses as transforms, shape (N, 4, 4).

    Raises:
        ConfigError: If a number is not finite or a quaternion is not of unit length.
    """
    values = np.array([_numbers(pose) for pose in poses]).reshape(-1, 7)
    if not np.isfinite(values).all():
        raise ConfigError(f"{what}: a pose holds a number that is not finite")
    norms = np.linalg.norm(values[:, 3:], axis=1)
    if (np.abs(norms - 1) > LEAST_NORM).any():
        raise ConfigError(
            f"{what}: a quaternion has length "
            f"{norms[np.abs(norms - 1).argmax()]:.3g}, expected 1"
        )
    if not len(values):
        return np.zeros((0, 4, 4))
    return pose_from(values[:, :3], values[:, 3:])


def from_pose(pose: Pose, what: str = "pose") -> FloatArray:
    """Return a pose as a transform, shape (4, 4); raises as ``from_poses``."""
    return from_poses([pose], what)[0]


def _numbers(pose: Pose) -> list[float]:
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def to_grasp_array(grasps: GraspList) -> GraspArray:
    """Return grasps as a message, poses with the axes that their info names."""
    info = grasps.info
    array = GraspArray(
        axes=info.axes,
        stage=info.stage,
        gripper=info.gripper,
        tcp_frame=info.tcp_frame,
        affordance_query=info.query,
        affordance_labels=list(info.labels),
        joint_names=list(info.joint_names),
        scene_revision=info.revision,
    )
    array.header.frame_id = info.frame_id
    array.header.stamp = to_stamp(info.stamp)
    array.grasps = _to_grasps(grasps, to_axes(grasps.grasps.poses, info.axes))
    return array


def _to_grasps(grasps: GraspList, poses: FloatArray) -> list[Grasp]:
    """Return messages, filled field by field: their constructors would cost double."""
    values, reach = grasps.grasps, grasps.reach or Reach.unknown(len(grasps))
    if not len(grasps):
        return []
    positions, quaternions = to_position_quaternion(poses)
    known = np.asarray(np.isfinite(grasps.contacts).all(axis=(1, 2)))
    items = [Grasp() for _ in known]
    for item, identity, arm, joints in zip(
        items, values.ids, reach.arms, reach.joints, strict=True
    ):
        item.id, item.arm, item.joint_positions = identity, arm, joints.tolist()
    for item, width, quality, affordance, scores, object_id in zip(
        items,
        values.widths.tolist(),
        values.quality.tolist(),
        grasps.affordance.tolist(),
        values.affordances.tolist(),
        values.object_ids.tolist(),
        strict=True,
    ):
        item.width, item.quality, item.affordance = width, quality, affordance
        item.affordance_scores, item.object_id = scores, object_id
    for item, code, manipulability in zip(
        items, reach.codes.tolist(), reach.manipulability.tolist(), strict=True
    ):
        item.reachability, item.manipulability = code, manipulability
    for item, xyz, xyzw, points, is_known in zip(
        items,
        positions.tolist(),
        quaternions.tolist(),
        grasps.contacts.tolist(),
        known,
        strict=True,
    ):
        _fill_pose(item.pose, xyz, xyzw)
        if is_known:
            item.contacts = [Point(x=x, y=y, z=z) for x, y, z in points]
    return items


def _fill_pose(pose: Pose, xyz: list[float], xyzw: list[float]) -> None:
    p, q = pose.position, pose.orientation
    p.x, p.y, p.z = xyz
    q.x, q.y, q.z, q.w = xyzw


def from_grasp_array(array: GraspArray) -> GraspList:
    """Return the grasps of a message, whoever made it, in our gripper frame.

    Missing ids are filled in; scores and reachability are kept as they are.

    Raises:
        ConfigError: If the frame is empty, the axes are unknown, a pose or width is no
            number, or an id comes twice.
    """
    if not array.header.frame_id:
        raise ConfigError("grasps: header.frame_id is empty")
    items, count = array.grasps, len(array.grasps)
    poses = from_axes(from_poses([g.pose for g in items], "grasps"), array.axes)
    widths = np.array([g.width for g in items], dtype=np.float64)
    if not (np.isfinite(widths) & (widths >= 0)).all():
        raise ConfigError("grasps: a width is negative or not a number")
    ids = tuple(g.id or f"g{i:04d}" for i, g in enumerate(items))
    if len(set(ids)) != count:
        raise ConfigError("grasps: an id comes twice")
    info = GraspInfo(
        frame_id=array.header.frame_id,
        stamp=from_stamp(array.header.stamp),
        axes=array.axes,
        stage=array.stage,
        gripper=array.gripper,
        tcp_frame=array.tcp_frame,
        query=array.affordance_query,
        labels=tuple(array.affordance_labels),
        joint_names=tuple(array.joint_names),
        revision=array.scene_revision,
    )
    grasp_set = GraspSet(
        poses,
        widths,
        np.array([g.quality for g in items], dtype=np.float64),
        _affordances(items),
        np.array([g.object_id for g in items], dtype=np.int32),
        ids,
    )
    affordance = np.array([g.affordance for g in items], dtype=np.float64)
    return GraspList(info, grasp_set, affordance, _contacts(items), _reach(items))


def _affordances(items: list[Grasp]) -> FloatArray:
    columns = {len(g.affordance_scores) for g in items}
    if len(columns) > 1:
        raise ConfigError("grasps: affordance_scores differ in length")
    rows = [list(g.affordance_scores) for g in items]
    return np.array(rows, dtype=np.float64).reshape(len(items), max(columns, default=0))


def _contacts(items: list[Grasp]) -> FloatArray:
    contacts = np.full((len(items), 2, 3), np.nan)
    for row, grasp in enumerate(items):
        if len(grasp.contacts) == 2:
            contacts[row] = [[p.x, p.y, p.z] for p in grasp.contacts]
    return contacts


def _reach(items: list[Grasp]) -> Reach:
    return Reach(
        codes=np.array([g.reachability for g in items], dtype=np.uint8),
        arms=tuple(g.arm for g in items),
        manipulability=np.array([g.manipulability for g in items], dtype=np.float64),
        joints=tuple(np.array(g.joint_positions, dtype=np.float64) for g in items),
    )


def to_pose_array(array: GraspArray) -> PoseArray:
    """Return the poses of a ``GraspArray``, as RViz draws them."""
    return PoseArray(header=array.header, poses=[g.pose for g in array.grasps])


def to_best_pose(array: GraspArray) -> PoseStamped:
    """Return the first pose of a ``GraspArray`` that holds at least one grasp."""
    return PoseStamped(header=array.header, pose=array.grasps[0].pose)


def to_tsdf(view: SceneView) -> TsdfMessage:
    """Return a scene's volume as a message, 32FC1."""
    volume = view.volume
    message = TsdfMessage(
        origin=to_pose(view.T_frame_task),
        voxel_size=volume.voxel_size,
        truncation=volume.truncation,
        encoding=TsdfMessage.ENCODING_32FC1,
        view_count=volume.view_count,
        revision=view.revision,
    )
    message.header.frame_id = view.frame_id
    message.header.stamp = to_stamp(view.stamp)
    message.size_x, message.size_y, message.size_z = volume.distances.shape
    message.distances = to_bytes(volume.distances.astype("<f4", copy=False))
    message.weights = to_bytes(volume.weights)
    return message


def from_tsdf(message: TsdfMessage) -> SceneView:
    """Return the scene that a volume message holds.

    Raises:
        ConfigError: If the encoding or the origin is none.
        ShapeError: If there are not as many values as voxels.
    """
    types = {TsdfMessage.ENCODING_32FC1: "<f4", TsdfMessage.ENCODING_16FC1: "<f2"}
    if message.encoding not in types:
        raise ConfigError(f"tsdf: encoding {message.encoding}; expected 0 or 1")
    dtype = np.dtype(types[message.encoding])
    shape = (message.size_x, message.size_y, message.size_z)
    count = int(np.prod(shape))
    for name, size in (("distances", count * dtype.itemsize), ("weights", count)):
        if len(getattr(message, name)) != size:
            raise ShapeError(name, f"({size},)", (len(getattr(message, name)),))
    distances = np.frombuffer(message.distances, dtype).reshape(shape)
    volume = TsdfVolume(
        distances.astype(np.float32),
        np.frombuffer(message.weights, np.uint8).reshape(shape).copy(),
        float(message.voxel_size),
        float(message.truncation),
        message.view_count,
    )
    return SceneView(
        volume=volume,
        T_frame_task=from_pose(message.origin, "tsdf origin"),
        frame_id=message.header.frame_id,
        stamp=from_stamp(message.header.stamp),
        revision=message.revision,
    )
