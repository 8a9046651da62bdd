# SPDX-License-Identifier: Apache-2.0
"""A whole robot in the physics world: loaded, driven, felt."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import pybullet
from numpy.typing import NDArray

from neugrasp_ros.errors import SimulationError
from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.gripper import Gripper
from sim_bridge.bodies import pose_tuple
from sim_bridge.gripper import CARRIAGE_FORCE, GEAR_ERP, GEAR_FORCE_RATIO, PAD_CONTACT
from sim_bridge.world import World

FloatArray = NDArray[np.float64]

POSITION_GAIN = 0.3
VELOCITY_GAIN = 1.0
WEIGHTLESS = (
    '<inertial><mass value="1e-6"/>'
    '<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial>'
)


@dataclass(frozen=True, eq=False, kw_only=True)
class RobotSetup:
    """All that the simulator needs to know of a robot.

    Attributes:
        urdf: Its description; written to a temporary folder while a world lives.
        joint_names: Joints of a configuration, in order.
        T_base_root: Pose of the URDF's root link in the base frame, shape (4, 4).
        jaws: For each gripper the names of its left and right slide.
        carriages: For each gripper the joint that carries the fingers ahead.
        grippers: Their measures.
    """

    urdf: str
    joint_names: tuple[str, ...]
    T_base_root: FloatArray
    jaws: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    carriages: Mapping[str, str] = field(default_factory=dict)
    grippers: Mapping[str, Gripper] = field(default_factory=dict)


class JointStates(NamedTuple):
    """Measured joints, in the order of the setup, each of shape (J,)."""

    positions: FloatArray
    velocities: FloatArray
    efforts: FloatArray


class Touch(NamedTuple):
    """A contact of the robot: a link, the other body, and the force in [N]."""

    link: str
    body: int
    force: float


class RobotBody:
    """A robot whose base is fixed.

    Args:
        world: The world it lives in.
        setup: The robot.
        T_world_base: Where it stands, shape (4, 4).
        q: Configuration that it starts in, shape (J,).

    Raises:
        SimulationError: If the engine refuses the description or lacks a joint.
    """

    def __init__(
        self, world: World, setup: RobotSetup, T_world_base: FloatArray, q: FloatArray
    ) -> None:
        self._world, self._setup = world, setup
        path = world.scratch_path("robot.urdf")
        path.write_text(_locked(setup))
        position, quaternion = pose_tuple(T_world_base @ setup.T_base_root)
        self.body = world.load_urdf(
            path, position=position, quaternion=quaternion, flags=0, fixed=True
        )
        infos = [
            pybullet.getJointInfo(self.body, index, physicsClientId=world.client)
            for index in range(
                pybullet.getNumJoints(self.body, physicsClientId=world.client)
            )
        ]
        known = {info[1].decode(): info for info in infos}
        missing = sorted(set(setup.joint_names) - set(known))
        if missing:
            raise SimulationError(f"the engine lacks joint {missing[0]}")
        self._links = {info[0]: info[12].decode() for info in infos}
        self._ids = [known[name][0] for name in setup.joint_names]
        self._forces = np.array([known[name][10] for name in setup.joint_names])
        self._carriages = {k: known[n][0] for k, n in setup.carriages.items()}
        self._jaws = {
            key: [setup.joint_names.index(name) for name in names]
            for key, names in setup.jaws.items()
        }
        self._pairs: list[tuple[int, int]] = []
        self._movers, self._parents = _moving_bodies(infos)
        self._fingers = {
            self._ids[c] for columns in self._jaws.values() for c in columns
        }
        self._join_fingers()
        self.reset(q)

    def reset(self, q: FloatArray) -> None:
        """Put all joints to a configuration (J,), at rest."""
        for index, value in zip(self._ids, q, strict=True):
            pybullet.resetJointState(
                self.body, index, value, 0.0, physicsClientId=self._world.client
            )
        for key, carriage in self._carriages.items():
            pybullet.resetJointState(
                self.body, carriage, self._advance(key, q), 0.0,
                physicsClientId=self._world.client,
            )  # fmt: skip
        self.command(q, np.zeros(len(q)))

    def command(self, positions: FloatArray, velocities: FloatArray) -> None:
        """Set where the joints' motors pull to, each of shape (J,).

        The motors are as strong as the description says, and no stronger.
        """
        pybullet.setJointMotorControlArray(
            self.body,
            self._ids,
            pybullet.POSITION_CONTROL,
            targetPositions=positions.tolist(),
            targetVelocities=velocities.tolist(),
            forces=self._forces.tolist(),
            positionGains=[POSITION_GAIN] * len(self._ids),
            velocityGains=[VELOCITY_GAIN] * len(self._ids),
            physicsClientId=self._world.client,
        )

    def states(self) -> JointStates:
        """Return what the joints' sensors say; carriages follow their jaws."""
        rows = pybullet.getJointStates(
            self.body, self._ids, physicsClientId=self._world.client
        )
        positions = np.array([row[0] for row in rows])
        for key, carriage in self._carriages.items():
            pybullet.setJointMotorControl2(
                self.body,
                carriage,
                pybullet.POSITION_CONTROL,
                targetPosition=self._advance(key, positions),
                positionGain=0.5,
                force=CARRIAGE_FORCE,
                physicsClientId=self._world.client,
            )
        return JointStates(
            positions,
            np.array([row[1] for row in rows]),
            np.array([row[3] for row in rows]),
        )

    def touches(self, others: Sequence[int]) -> list[Touch]:
        """Return the contacts of the last step with some bodies."""
        return [
            Touch(self._links.get(contact.link_a, "base"), other, contact.force)
            for other in others
            for contact in self._world.contacts(self.body, other)
            if contact.force > 0.0
        ]

    def place(self, q: FloatArray) -> None:
        """Put all joints to a configuration (J,), for questions about distance only."""
        for index, value in zip(self._ids, q, strict=True):
            pybullet.resetJointState(
                self.body, index, value, 0.0, physicsClientId=self._world.client
            )

    def depth_in(self, other: int) -> float:
        """Return how deep it is in another body in [m]; 0 = it is not."""
        points = pybullet.getClosestPoints(
            self.body, other, 0.0, physicsClientId=self._world.client
        )
        return max((-float(point[8]) for point in points), default=0.0)

    def own_depth(self) -> float:
        """Return how deep its links are in each other in [m]; 0 = they are not.

        Links of one moving body, or of two that share a joint, may touch; so may the
        two fingers of a hand and what carries them.
        """
        depth = 0.0
        for first, second in self._own_pairs():
            points = pybullet.getClosestPoints(
                self.body, self.body, 0.0, first, second,
                physicsClientId=self._world.client,
            )  # fmt: skip
            depth = max([depth, *(-float(point[8]) for point in points)])
        return depth

    def _own_pairs(self) -> list[tuple[int, int]]:
        """Return the pairs of solid links that must not be in each other."""
        if not self._pairs:
            solid = [
                link
                for link in self._movers
                if pybullet.getCollisionShapeData(
                    self.body, link, physicsClientId=self._world.client
                )
            ]
            self._pairs = [
                (a, b)
                for k, a in enumerate(solid)
                for b in solid[k + 1 :]
                if self._movers[a] != self._movers[b]
                and not self._are_neighbours(self._movers[a], self._movers[b])
            ]
        return self._pairs

    def _are_neighbours(self, first: int, second: int) -> bool:
        parents = self._parents
        if first in self._fingers and second in self._fingers:
            return parents[first] == parents[second]
        return parents.get(first) == second or parents.get(second) == first

    def _advance(self, key: str, q: FloatArray) -> float:
        opening = float(q[self._jaws[key]].sum())
        return float(tip_advance_at(self._setup.grippers[key], opening))

    def _join_fingers(self) -> None:
        """Couple both fingers of each gripper, and give their pads a grip."""
        client = self._world.client
        for key, columns in self._jaws.items():
            left, right = (self._ids[column] for column in columns)
            for finger in (left, right):
                self._world.change_dynamics(self.body, link=finger, **PAD_CONTACT)
            gear = pybullet.createConstraint(
                self.body, left, self.body, right, pybullet.JOINT_GEAR,
                [1, 0, 0], [0, 0, 0], [0, 0, 0], physicsClientId=client,
            )  # fmt: skip
            pybullet.changeConstraint(
                gear,
                gearRatio=-1,
                erp=GEAR_ERP,
                maxForce=GEAR_FORCE_RATIO * self._setup.grippers[key].max_force,
                physicsClientId=client,
            )


def _moving_bodies(infos: Sequence[Any]) -> tuple[dict[int, int], dict[int, int]]:
    """Return for each link the joint that moves it, and for each such joint the next.

    The base is -1.
    """
    movers, parents = {-1: -1}, {}
    for info in infos:
        index, kind, parent = info[0], info[2], info[16]
        if kind == pybullet.JOINT_FIXED:
            movers[index] = movers[parent]
        else:
            movers[index] = index
            parents[index] = movers[parent]
    return movers, parents


def _locked(setup: RobotSetup) -> str:
    """Return the description with all joints fixed that nothing here moves."""
    robot = ElementTree.fromstring(setup.urdf)
    moving = {*setup.joint_names, *setup.carriages.values()}
    for joint in robot.findall("joint"):
        if joint.get("name") not in moving:
            joint.set("type", "fixed")
    for link in robot.findall("link"):
        if link.find("inertial") is None:  # a mere frame; the engine would take 1 kg
            link.append(ElementTree.fromstring(WEIGHTLESS))
    return ElementTree.tostring(robot, encoding="unicode")
