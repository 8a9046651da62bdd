# SPDX-License-Identifier: Apache-2.0
"""A parallel-jaw gripper in the physics world, built from one ``Gripper`` value."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
import pybullet
from numpy.typing import NDArray

from neugrasp_ros.errors import SimulationError
from neugrasp_ros.geometry.finger_joint import tip_advance_at
from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import translation
from sim_bridge.bodies import pose_tuple, transform_from
from sim_bridge.contact import Contact
from sim_bridge.gripper_body import (
    base_center_of_mass,
    write_gripper_urdf,
)
from sim_bridge.world import World

FloatArray = NDArray[np.float64]

HOLD_FORCE = 300.0  # [N], with which the hand follows its commanded pose
CARRIAGE_FORCE = 500.0  # [N], a linkage does not give way along z
GEAR_FORCE_RATIO = 2.5  # coupling force over rated force: 50 N for the Panda hand
GEAR_ERP = 0.1
JAW_STEPS = 120  # half a second for closing or opening
STEPS_PER_LOOK = 5  # between two looks whether the jaws are shut
PARKED = translation(0.15, 0.15, 3.0)  # far above anything

PAD_CONTACT = {
    "lateralFriction": 1.0,
    "spinningFriction": 0.1,
    "contactStiffness": 3e4,
    "contactDamping": 1e3,
    "frictionAnchor": 1,
}


class FingerContacts(NamedTuple):
    """Bodies that each finger touches."""

    left: frozenset[int]
    right: frozenset[int]


class SimGripper:
    """A hand held in the air by a constraint, with two coupled sliding fingers.

    The pose of the gripper is that of its frame: the TCP with open jaws. On a linkage
    gripper the tips move ahead of it while the jaws close (``tip_advance_at``).

    Args:
        world: The world it lives in; it is parked far above the table.
        gripper: Its measures.
        pad_friction: Lateral friction coefficient of the fingers [-].
    """

    def __init__(
        self, world: World, gripper: Gripper, pad_friction: float = 1.0
    ) -> None:
        self.world = world
        self.gripper = gripper
        self._center = base_center_of_mass(gripper)
        path = world.scratch_path("gripper.urdf")
        write_gripper_urdf(gripper, path)
        position, quaternion = pose_tuple(PARKED)
        self.body = world.load_urdf(path, position=position, quaternion=quaternion)
        joints = self._joints_by_name()
        self._left, self._right = joints["left"], joints["right"]
        self._carriage = joints.get("advance")
        for finger in (self._left, self._right):
            values = PAD_CONTACT | {"lateralFriction": pad_friction}
            world.change_dynamics(self.body, link=finger, **values)
        self._constrain()
        self.park()

    def _joints_by_name(self) -> dict[str, int]:
        client = self.world.client
        count = pybullet.getNumJoints(self.body, physicsClientId=client)
        infos = [
            pybullet.getJointInfo(self.body, index, physicsClientId=client)
            for index in range(count)
        ]
        return {info[1].decode(): info[0] for info in infos}

    def _constrain(self) -> None:
        client = self.world.client
        self._hold = pybullet.createConstraint(
            self.body, -1, -1, -1, pybullet.JOINT_FIXED,
            [0, 0, 0], [0, 0, 0], [0, 0, 0], physicsClientId=client,
        )  # fmt: skip
        self._gear = pybullet.createConstraint(
            self.body, self._left, self.body, self._right, pybullet.JOINT_GEAR,
            [1, 0, 0], [0, 0, 0], [0, 0, 0], physicsClientId=client,
        )  # fmt: skip
        pybullet.changeConstraint(
            self._gear,
            gearRatio=-1,
            erp=GEAR_ERP,
            maxForce=GEAR_FORCE_RATIO * self.gripper.max_force,
            physicsClientId=client,
        )

    def remove(self) -> None:
        """Take the gripper out of the world."""
        for constraint in (self._hold, self._gear):
            pybullet.removeConstraint(constraint, physicsClientId=self.world.client)
        self.world.remove(self.body)

    def park(self) -> None:
        """Put the gripper, open, where it touches nothing."""
        self.teleport(PARKED, self.gripper.max_opening)

    def teleport(self, T_world_gripper: FloatArray, opening: float) -> None:
        """Put the gripper at a pose, at rest, its jaws open by ``opening`` [m].

        Raises:
            SimulationError: If the jaws do not open that far.
        """
        if not 0.0 <= opening <= self.gripper.max_opening + 1e-9:
            raise SimulationError(
                f"opening must be within [0, {self.gripper.max_opening}] m, "
                f"got {opening}"
            )
        self._place(T_world_gripper)
        pybullet.resetBaseVelocity(
            self.body, [0, 0, 0], [0, 0, 0], physicsClientId=self.world.client
        )
        self._reset_jaws(opening)
        self.command(T_world_gripper)
        self._drive_jaws(opening, self.gripper.max_force, None)

    def _place(self, T_world_gripper: FloatArray) -> None:
        position, quaternion = pose_tuple(T_world_gripper, self._center)
        pybullet.resetBasePositionAndOrientation(
            self.body, position, quaternion, physicsClientId=self.world.client
        )

    def _reset_jaws(self, opening: float) -> None:
        client = self.world.client
        for finger in (self._left, self._right):
            pybullet.resetJointState(
                self.body, finger, opening / 2, 0.0, physicsClientId=client
            )
        if self._carriage is not None:
            advance = float(tip_advance_at(self.gripper, opening))
            pybullet.resetJointState(
                self.body, self._carriage, advance, 0.0, physicsClientId=client
            )

    def command(self, T_world_gripper: FloatArray) -> None:
        """Set the pose that the hand is drawn to."""
        self._commanded = np.array(T_world_gripper)
        position, quaternion = pose_tuple(T_world_gripper, self._center)
        pybullet.changeConstraint(
            self._hold,
            jointChildPivot=position,
            jointChildFrameOrientation=quaternion,
            maxForce=HOLD_FORCE,
            physicsClientId=self.world.client,
        )

    @property
    def commanded(self) -> FloatArray:
        """The pose that the hand is drawn to, ``T_world_gripper``, shape (4, 4)."""
        return self._commanded.copy()

    def pose(self) -> FloatArray:
        """Return where the gripper really is, ``T_world_gripper``, shape (4, 4)."""
        position, quaternion = pybullet.getBasePositionAndOrientation(
            self.body, physicsClientId=self.world.client
        )
        T_world_gripper = transform_from(position, quaternion)
        T_world_gripper[:3, 3] -= T_world_gripper[:3, :3] @ self._center
        return T_world_gripper

    def follow(
        self,
        T_world_grippers: Iterable[FloatArray],
        steps: int,
        should_stop: Callable[[], bool] | None = None,
    ) -> int | None:
        """Command poses one after the other.

        Args:
            T_world_grippers: The poses, each (4, 4).
            steps: Physics steps for each of them.
            should_stop: Asked after each pose; True ends the motion.

        Returns:
            Index of the pose at which the motion was stopped, None if it was not.
        """
        for index, T_world_gripper in enumerate(T_world_grippers):
            self.command(T_world_gripper)
            self.world.step(steps)
            if should_stop is not None and should_stop():
                return index
        return None

    def close(
        self,
        *,
        force: float | None = None,
        speed: float | None = None,
        shut_at: float = -np.inf,
    ) -> None:
        """Close the jaws for half a second.

        What is held goes on moving for a while after the jaws stand still, so nothing
        short of the whole time tells how it will be held.

        Args:
            force: Of each finger in [N]; default the rated one.
            speed: Limit for each finger in [m/s]; default none.
            shut_at: End as soon as the jaws are less than this open, in [m].
        """
        self._move_jaws(0.0, force, speed, shut_at=shut_at)

    def open(self, opening: float | None = None) -> None:
        """Open the jaws for half a second; by default as far as they go."""
        self._move_jaws(
            self.gripper.max_opening if opening is None else opening, None, None
        )

    def _move_jaws(
        self,
        opening: float,
        force: float | None,
        speed: float | None,
        *,
        shut_at: float = -np.inf,
    ) -> None:
        force = self.gripper.max_force if force is None else force
        self._drive_jaws(opening, force, speed)
        for _ in range(JAW_STEPS // STEPS_PER_LOOK):
            self._step_jaws(STEPS_PER_LOOK)
            if self.width() < shut_at:
                return

    def _step_jaws(self, count: int) -> None:
        """Step while the carriage of a linkage gripper follows the jaws."""
        if self._carriage is None:
            self.world.step(count)
            return
        for _ in range(count):
            self._drive_carriage(float(tip_advance_at(self.gripper, self.width())))
            self.world.step()

    def _drive_jaws(self, opening: float, force: float, speed: float | None) -> None:
        limit = {} if speed is None else {"maxVelocity": speed}
        for finger in (self._left, self._right):
            pybullet.setJointMotorControl2(
                self.body,
                finger,
                pybullet.POSITION_CONTROL,
                targetPosition=opening / 2,
                force=force,
                physicsClientId=self.world.client,
                **limit,
            )
        if self._carriage is not None:
            self._drive_carriage(float(tip_advance_at(self.gripper, self.width())))

    def _drive_carriage(self, advance: float) -> None:
        pybullet.setJointMotorControl2(
            self.body,
            self._carriage,
            pybullet.POSITION_CONTROL,
            targetPosition=advance,
            positionGain=0.5,
            force=CARRIAGE_FORCE,
            physicsClientId=self.world.client,
        )

    def width(self) -> float:
        """Return the distance of the inner pad faces in [m]."""
        states = pybullet.getJointStates(
            self.body, [self._left, self._right], physicsClientId=self.world.client
        )
        return float(states[0][0] + states[1][0])

    def has_contact(self) -> bool:
        """Tell whether the last step found any contact of the gripper."""
        return self.world.has_contact(self.body)

    def contacts(self) -> list[Contact]:
        """Return the gripper's contacts; it is the first body of each."""
        return self.world.contacts(self.body)

    def finger_contacts(self) -> FingerContacts:
        """Return which bodies each finger presses on or overlaps."""
        touching = [c for c in self.contacts() if c.force > 0.0 or c.distance <= 0.0]
        return FingerContacts(
            frozenset(c.body_b for c in touching if c.link_a == self._left),
            frozenset(c.body_b for c in touching if c.link_a == self._right),
        )

    def query_contacts(
        self, T_world_gripper: FloatArray, opening: float
    ) -> list[Contact]:
        """Return what the gripper would touch at a pose, without advancing time.

        The gripper stays there, so teleport it or restore a state before stepping.
        Contacts come with gaps up to about 2 mm (the engine's contact threshold).
        """
        self._place(T_world_gripper)
        self._reset_jaws(opening)
        self.world.detect_collisions()
        return self.contacts()
