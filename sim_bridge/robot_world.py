# SPDX-License-Identifier: Apache-2.0
"""A living world with a whole robot at a piece of furniture.

Poses of the physics world are those of the task frame, whose corner lies 5 cm under
the furniture's top; where the robot stands in it is drawn anew with every scene.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import SimulationError
from neugrasp_ros.geometry.finger_joint import joint_at, opening_at
from neugrasp_ros.geometry.transform import invert, translation
from sim_bridge.bridge_world import (
    BridgeScenes,
    BridgeWorld,
    Snapshot,
)
from sim_bridge.contact import BodyDynamics
from sim_bridge.furniture import BINS, FURNITURE, Block, Furniture, read_kind
from sim_bridge.joint_drive import DriveLimits, DriveState, JointDrive
from sim_bridge.limit_watch import LimitUse
from sim_bridge.objects.model import ObjectModel
from sim_bridge.robot_body import RobotBody, RobotSetup, Touch
from sim_bridge.scenes import build_scene
from sim_bridge.trial_result import TrialResult
from sim_bridge.world import World

FloatArray = NDArray[np.float64]

ROLLING = 1e-3  # [m]; rolling and spinning friction of objects
SOLVER_ITERATIONS = 50  # with which results/robot_*.json were made
CONTROL_STEPS = 2  # physics steps between two set points: 120 Hz


def finger_joint(key: str) -> str:
    """Return the joint by which a gripper's driver is told how far to close."""
    return f"gripper_{key}_finger_joint"


class Stance(NamedTuple):
    """How the robot stands when a scene begins.

    Attributes:
        T_base_world: The task frame as seen from its base, shape (4, 4).
        q: Its configuration, shape (J,).
    """

    T_base_world: FloatArray
    q: FloatArray


class RobotView(NamedTuple):
    """The robot at one time.

    Attributes:
        q: Measured configuration, shape (J,).
        velocities: Shape (J,).
        efforts: Of the motors in [Nm] or [N], shape (J,).
        fingers: Values of the grippers' finger joints by name.
        stance: How the scene began.
        blocks: Furniture and bins, in the base frame.
    """

    q: FloatArray
    velocities: FloatArray
    efforts: FloatArray
    fingers: Mapping[str, float]
    stance: Stance
    blocks: tuple[Block, ...]


class _FurnishedWorld(World):
    """A world whose table is the furniture, and which drives the robot."""

    def __init__(
        self, before_step: Callable[[], None], on_steps: Callable[[int], None]
    ) -> None:
        self._before_step, self._on_steps = before_step, on_steps
        self.furniture = FURNITURE["table"]
        self.T_world_base = np.eye(4)
        self.blocks: dict[int, Block] = {}
        super().__init__(sleeping=True, solver_iterations=SOLVER_ITERATIONS)

    def load_table(self) -> int:
        """Load the furniture's support and what is not in the way of objects."""
        self.blocks = {}
        self.table = self.load_block(self.furniture.support)
        for block in self.furniture.others:
            self.load_block(block)
        return self.table

    def load_block(self, block: Block) -> int:
        """Load a block given in the robot's base frame."""
        body = self.load_box(
            block.size / 2, self.T_world_base @ translation(*block.center)
        )
        self.blocks[body] = block
        return body

    def load_object(
        self,
        model: ObjectModel,
        T_world_object: FloatArray,
        dynamics: BodyDynamics | None = None,
    ) -> int:
        """Load an object that does not roll on for ever, as none does on wood."""
        dynamics = replace(
            dynamics or BodyDynamics(), rolling=ROLLING, spinning=ROLLING
        )
        return super().load_object(model, T_world_object, dynamics)

    def step(self, count: int = 1) -> None:
        """Advance time; the robot's motors are told where to pull every few steps."""
        for done in range(0, count, CONTROL_STEPS):
            steps = min(CONTROL_STEPS, count - done)
            self._before_step()
            super().step(steps)
            self._on_steps(steps)


class RobotWorld(BridgeWorld):
    """Physics of furniture, objects and a whole robot.

    Args:
        setup: The robot.
        controllers: Joints of each controller; a gripper's is its one finger joint.
        limits: Bounds of each controller's joints.
        stand: Says how the robot stands at a furniture for a seed.
        scenes: What scenes are made of.
        realtime_factor: Simulated over real time; 0 = as fast as possible.
        lockstep: Time goes on only with ``advance``.

    Attributes:
        largest_touch: The strongest contact of robot and furniture in this scene.
        limit_use: How much of their limits the drives' set points used in this scene.
    """

    def __init__(
        self,
        setup: RobotSetup,
        controllers: Mapping[str, tuple[str, ...]],
        limits: Mapping[str, DriveLimits],
        stand: Callable[[Furniture, int], Stance],
        scenes: BridgeScenes,
        realtime_factor: float = 1.0,
        *,
        lockstep: bool = False,
    ) -> None:
        self.setup, self.controllers = setup, controllers
        self._limits, self._stand = limits, stand
        self._body: RobotBody | None = None
        self.drives: dict[str, JointDrive] = {}
        self.largest_touch = Touch("", -1, 0.0)
        self.limit_use = LimitUse()
        self.furniture = FURNITURE["table"]
        gripper = next(iter(setup.grippers.values()))
        super().__init__(gripper, scenes, realtime_factor, lockstep=lockstep)

    def check_kind(self, kind: str) -> None:
        """Refuse unknown furniture and scene kinds.

        Raises:
            UnknownNameError: If one is unknown.
        """
        self.scenes.load(read_kind(kind)[1])

    def try_grasp(
        self, T_task_gripper: FloatArray, opening: float, lift_height: float
    ) -> TrialResult:
        """Refuse: this world has an arm for it.

        Raises:
            SimulationError: Always.
        """
        raise SimulationError(
            "the whole robot does not teleport its hand: send the grasp to the action "
            "execute_grasp"
        )

    def _make_world(self) -> World:
        return _FurnishedWorld(self._drive, self._on_steps)

    def _build(self, kind: str, seed: int, count: int) -> None:
        assert isinstance(self._world, _FurnishedWorld)
        world = self._world
        self._body = None
        self.drives = {  # what the old ones followed ends here, whatever comes
            name: JointDrive(drive.names, drive.limits, drive.target)
            for name, drive in self.drives.items()
        }
        self.furniture, how = read_kind(kind)
        objects, names = self.scenes.load(how)
        how = "pile" if how == "affordance" else how
        self._stance = self._stand(self.furniture, seed)
        world.furniture = self.furniture
        world.T_world_base = invert(self._stance.T_base_world)
        rng = np.random.default_rng(seed)
        build_scene(world, how, objects, names, rng, count=count, seed=seed)
        for bin_ in BINS.values():
            for block in bin_.blocks():
                world.load_block(block)
        for block in self.furniture.later:
            world.load_block(block)
        body = RobotBody(world, self.setup, world.T_world_base, self._stance.q)
        self.drives = {
            name: JointDrive(joints, self._limits[name], self._start_of(joints))
            for name, joints in self.controllers.items()
        }
        self.largest_touch = Touch("", -1, 0.0)
        self.limit_use = LimitUse()
        self._body = body
        self._blocks = tuple(world.blocks.values())
        self._states = body.states()

    def _start_of(self, joints: tuple[str, ...]) -> FloatArray:
        """Return where joints are in the stance; finger joints are computed."""
        return np.array([self._value(name, self._stance.q) for name in joints])

    def _value(self, name: str, q: FloatArray) -> float:
        names = self.setup.joint_names
        if name in names:
            return float(q[names.index(name)])
        key = self._gripper_of(name)
        columns = [names.index(slide) for slide in self.setup.jaws[key]]
        return joint_at(self.setup.grippers[key], float(q[columns].sum()))

    def _gripper_of(self, joint: str) -> str:
        return next(key for key in self.setup.jaws if joint == finger_joint(key))

    @property
    def now(self) -> float:
        """Simulated time in [s]."""
        return self._time / 1e9

    def following(self, controller: str) -> tuple[FloatArray, FloatArray]:
        """Return where a controller's joints are, and where they shall be, (n,)."""
        drive = self.drives[controller]
        q = self._states.positions
        return np.array([self._value(name, q) for name in drive.names]), drive.target

    def _drive(self) -> None:
        """Tell the motors where to pull in the coming step."""
        body = self._body
        if body is None:
            return
        names, now = self.setup.joint_names, self.now
        self._states = body.states()
        position, velocity = self._stance.q.copy(), np.zeros(len(names))
        for drive in self.drives.values():
            moves = drive.state is not DriveState.HOLDING
            point = drive.setpoint(now)
            if moves:
                self.limit_use = self.limit_use.including(point, drive.limits)
            for joint, value, speed in zip(
                drive.names, point.position, point.velocity, strict=True
            ):
                if joint in names:
                    column = names.index(joint)
                    position[column], velocity[column] = value, speed
                else:
                    key = self._gripper_of(joint)
                    half = opening_at(self.setup.grippers[key], float(value)) / 2
                    for slide in self.setup.jaws[key]:
                        position[names.index(slide)] = half
        body.command(position, velocity)

    def _on_steps(self, steps: int) -> None:
        if self._live and self._body is not None:
            assert isinstance(self._world, _FurnishedWorld)
            touches = self._body.touches(tuple(self._world.blocks))
            self.largest_touch = max(
                [self.largest_touch, *touches], key=lambda touch: touch.force
            )
        super()._on_steps(steps)

    def _places(self) -> FloatArray | None:
        """Return poses and joint values; None while a drive moves."""
        if any(d.state is not DriveState.HOLDING for d in self.drives.values()):
            return None
        robot = self.snapshot.robot
        if robot is None:  # no scene has been built so far
            return None
        return np.concatenate([self.snapshot.poses.ravel(), robot.q])

    def _look(self) -> Snapshot:
        plain = super()._look()
        if self._body is None:  # a scene could not be built: as it was seen last
            return plain._replace(robot=self.snapshot.robot)
        q = self._states.positions
        return plain._replace(
            robot=RobotView(
                q=q,
                velocities=self._states.velocities,
                efforts=self._states.efforts,
                fingers={
                    finger_joint(key): self._value(finger_joint(key), q)
                    for key in self.setup.jaws
                },
                stance=self._stance,
                blocks=self._blocks,
            )
        )
