# SPDX-License-Identifier: Apache-2.0
"""The robot as names, limits, groups and forward kinematics; Pinocchio stays inside.

A configuration ``q`` is one value per joint of ``joint_names`` in [rad] or [m],
shape (J,). The joints are those of the planning groups and the finger slides of the
mounted grippers; all others are locked at their neutral position.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, RobotModelError, ShapeError
from neugrasp_ros.geometry.gripper import Gripper, load_gripper
from neugrasp_ros.geometry.transform import invert, make_transform
from neugrasp_ros.robot.chain import SerialChain, make_chain
from neugrasp_ros.robot.description import RobotDescription, load_description
from neugrasp_ros.robot.urdf import derive_urdf, finger_joints

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

R_TCP_GRIPPER = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Our gripper axes in the TCP frame: z (approach) is its x, y (closing) its y."""


def gripper_from_tcp(T_a_tcp: FloatArray) -> FloatArray:
    """Turn TCP poses (x approach, y closing) into gripper poses (z approach).

    Args:
        T_a_tcp: Poses of ``gripper_<side>_tcp`` in any frame, shape (..., 4, 4).

    Returns:
        Poses ``T_a_gripper`` with the same origin, shape (..., 4, 4).
    """
    return T_a_tcp @ make_transform(R_TCP_GRIPPER, np.zeros(3))


def tcp_from_gripper(T_a_gripper: FloatArray) -> FloatArray:
    """Turn gripper poses (z approach, y closing) into TCP poses (x approach)."""
    return T_a_gripper @ make_transform(R_TCP_GRIPPER.T, np.zeros(3))


@dataclass(frozen=True, slots=True)
class JointLimits:
    """Bounds per joint, each of shape (J,), in [rad] or [m] and its derivatives."""

    lower: FloatArray
    upper: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    def take(self, indices: IntArray) -> "JointLimits":
        """Return the limits of some joints, in the order of ``indices``."""
        return JointLimits(
            *(getattr(self, name)[indices] for name in self.__dataclass_fields__)
        )


@dataclass(frozen=True, slots=True)
class Engine:
    """Pinocchio's own objects, for the modules of this package only."""

    model: Any
    data: Any
    geometry: Any


class RobotModel:
    """A robot with its joints, groups, frames and forward kinematics.

    Attributes:
        description: What the YAML file says.
        urdf: The robot as one URDF text (see ``derive_urdf`` for its licence).
        joint_names: Joints of a configuration, in order.
        limits: Their bounds.
        home: Resting configuration, shape (J,).
        grippers: Mounted grippers by key.
        T_base_root: Pose of the URDF's root link in the base frame, shape (4, 4).
        engine: Pinocchio's objects; private to this package.
    """

    def __init__(self, description: RobotDescription) -> None:
        """Read the URDF, mount the grippers, and lock what no group moves.

        Raises:
            RobotModelError: If a link, joint or frame of the description is missing.
        """
        self.description = description
        self.urdf = derive_urdf(description)
        self.grippers: dict[str, Gripper] = {
            key: load_gripper(mount.gripper)
            for key, mount in description.grippers.items()
        }
        self.engine = _build_engine(self.urdf, _moving_joints(description))
        model = self.engine.model
        self.joint_names: tuple[str, ...] = tuple(model.names)[1:]
        self._q_starts = np.array(model.idx_qs)[1:]
        self._continuous = np.array(model.nqs)[1:] == 2
        self.limits = self._read_limits()
        self.T_base_root = self._read_base()
        for name in description.arms:
            self._frame_id(description.groups[name].tcp_frame)
        self.home = self.configuration(description.home, strict=True)

    @property
    def frame_names(self) -> tuple[str, ...]:
        """Names of all links and added frames."""
        return tuple(
            f.name for f in self.engine.model.frames if f.type == pin.FrameType.BODY
        )

    def configuration(
        self,
        positions: Mapping[str, float],
        *,
        default: FloatArray | None = None,
        strict: bool = False,
    ) -> FloatArray:
        """Assemble a configuration from joint values by name.

        Args:
            positions: Joint values in [rad] or [m]; other joints' are ignored.
            default: Values of joints that are not in it, shape (J,); without it, zero,
                the nearest limit, and open jaws.
            strict: Refuse names that are not a joint of this model.

        Returns:
            Configuration, shape (J,).

        Raises:
            RobotModelError: If ``strict`` and a name is not a joint.
        """
        if default is None:
            q = np.clip(np.zeros(len(self.joint_names)), *self._hard_limits())
            for key in self.grippers:
                self.set_opening(q, key, self.grippers[key].max_opening)
        else:
            q = np.array(default, dtype=np.float64)
        for name, value in positions.items():
            if name in self.joint_names:
                q[self.joint_names.index(name)] = value
            elif strict:
                raise RobotModelError("joint", name, self.joint_names)
        return q

    def set_opening(self, q: FloatArray, gripper: str, opening: float) -> None:
        """Write a jaw opening in [m] into a configuration, in place."""
        for name in finger_joints(gripper):
            q[self.joint_names.index(name)] = opening / 2

    def group_indices(self, group: str) -> IntArray:
        """Return where the joints of a group stand in a configuration.

        Raises:
            RobotModelError: If there is no such group.
        """
        groups = self.description.groups
        if group not in groups:
            raise RobotModelError("group", group, groups)
        return np.array([self.joint_names.index(n) for n in groups[group].joints])

    def frame_pose(self, q: FloatArray, frame: str) -> FloatArray:
        """Return the pose ``T_base_frame``, shape (4, 4).

        Args:
            q: Configuration, shape (J,).
            frame: Name of a link or an added frame.

        Raises:
            RobotModelError: If there is no such frame.
            ShapeError: If ``q`` is not of shape (J,).
        """
        index = self._frame_id(frame)
        model, data = self.engine.model, self.engine.data
        pin.forwardKinematics(model, data, self.to_engine(q))
        placement = pin.updateFramePlacement(model, data, index)
        return np.asarray(self.T_base_root @ placement.homogeneous)

    def to_engine(self, q: FloatArray) -> FloatArray:
        """Return Pinocchio's configuration vector: continuous joints are (cos, sin)."""
        if np.shape(q) != (len(self.joint_names),):
            expected = f"({len(self.joint_names)},)"
            raise ShapeError("configuration", expected, np.shape(q))
        if not self._continuous.any():
            return np.asarray(q, dtype=np.float64)
        vector = np.empty(self.engine.model.nq)
        vector[self._q_starts] = np.where(self._continuous, np.cos(q), q)
        vector[self._q_starts[self._continuous] + 1] = np.sin(q[self._continuous])
        return vector

    def chain(self, group: str) -> SerialChain:
        """Return the joints from the base to a group's TCP as plain arrays.

        Raises:
            RobotModelError: If there is no such group.
            ConfigError: If the group has no hand, or not exactly the moving joints
                between base and TCP.
        """
        indices = self.group_indices(group)
        tcp = self.description.groups[group].tcp_frame
        if not tcp:
            raise ConfigError(f"group {group} has no tcp_frame")
        model, data = self.engine.model, self.engine.data
        frame = model.frames[self._frame_id(tcp)]
        supports = list(model.supports[frame.parentJoint])[1:]
        if supports != [int(index) + 1 for index in indices]:
            path = [model.names[joint] for joint in supports]
            raise ConfigError(f"group {group}: its joints must be, in order, {path}")
        neutral = pin.neutral(model)
        placements = [model.jointPlacements[j].homogeneous for j in supports]
        placements[0] = self.T_base_root @ placements[0]
        columns = np.array(
            [
                pin.computeJointJacobian(model, data, neutral, j)[:, model.idx_vs[j]]
                for j in supports
            ]
        )
        sliding = np.abs(columns[:, :3]).sum(axis=1) > 0.5
        limits = self.limits.take(indices)
        return make_chain(
            placements=np.array([*placements, frame.placement.homogeneous]),
            axes=np.where(sliding[:, None], columns[:, :3], columns[:, 3:]),
            prismatic=sliding,
            lower=limits.lower,
            upper=limits.upper,
        )

    def _hard_limits(self) -> tuple[FloatArray, FloatArray]:
        return self.limits.lower, self.limits.upper

    def _frame_id(self, frame: str) -> int:
        model = self.engine.model
        if not model.existFrame(frame, pin.FrameType.BODY):
            raise RobotModelError("frame", frame, self.frame_names)
        return int(model.getFrameId(frame, pin.FrameType.BODY))

    def _read_base(self) -> FloatArray:
        base = self.engine.model.frames[self._frame_id(self.description.base_frame)]
        if base.parentJoint != 0:
            raise ConfigError(f"base_frame {base.name} moves with a joint")
        return invert(base.placement.homogeneous)

    def _read_limits(self) -> JointLimits:
        model = self.engine.model
        lower = np.where(
            self._continuous, -np.pi, model.lowerPositionLimit[self._q_starts]
        )
        upper = np.where(
            self._continuous, np.pi, model.upperPositionLimit[self._q_starts]
        )
        table = self.description.motion_limits
        for name in table:
            if name != "default" and name not in self.joint_names:
                raise RobotModelError("joint", name, self.joint_names)
        rows = [table.get(n, table.get("default")) for n in self.joint_names]
        return JointLimits(
            lower=lower,
            upper=upper,
            velocity=np.array(model.velocityLimit),
            acceleration=np.array([r.acceleration if r else np.inf for r in rows]),
            jerk=np.array([r.jerk if r else np.inf for r in rows]),
        )


def load_robot(name_or_path: str | Path, urdf: Path | None = None) -> RobotModel:
    """Load a robot by its name or its YAML file (see ``load_description``)."""
    return RobotModel(load_description(name_or_path, urdf))


def _moving_joints(description: RobotDescription) -> list[str]:
    names = [name for group in description.groups.values() for name in group.joints]
    for key in description.grippers:
        names += finger_joints(key)
    return names


def _build_engine(urdf: str, moving: Sequence[str]) -> Engine:
    model = pin.buildModelFromXML(urdf)
    geometry = pin.buildGeomFromUrdfString(model, urdf, pin.GeometryType.COLLISION)
    names = tuple(model.names)
    for name in moving:
        if name not in names:
            raise RobotModelError("joint", name, names[1:])
    for item in geometry.geometryObjects:
        if type(item.geometry).__name__.startswith("BVH"):
            item.geometry.buildConvexHull(True, "Qt")
            item.geometry = item.geometry.convex
    locked = [model.getJointId(n) for n in names[1:] if n not in moving]
    reduced, reduced_geometry = pin.buildReducedModel(
        model, geometry, locked, pin.neutral(model)
    )
    return Engine(reduced, reduced.createData(), reduced_geometry)
