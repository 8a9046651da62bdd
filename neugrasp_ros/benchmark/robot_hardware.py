# SPDX-License-Identifier: Apache-2.0
"""The simulated robot without ROS: it moves, senses and looks in simulated time.

Time goes on only while something moves, so that a round does not depend on how busy
the machine is.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import MotionError
from neugrasp_ros.fusion.tsdf import empty_volume, integrate
from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.finger_joint import joint_at
from neugrasp_ros.geometry.transform import invert, translation
from neugrasp_ros.manipulation.mover import Surroundings
from neugrasp_ros.manipulation.scene_watch import SceneWatch, SeenScene
from neugrasp_ros.motion.limits import Trajectory
from neugrasp_ros.robot.collision import CollisionChecker
from neugrasp_ros.robot.link_meshes import LinkMeshes
from neugrasp_ros.robot.model import RobotModel
from neugrasp_ros.robot.obstacles import SolidBox
from sim_bridge.bridge_world import BridgeScenes
from sim_bridge.furniture import BINS, Furniture
from sim_bridge.joint_drive import DriveState
from sim_bridge.robot_camera import Parts, RobotCamera
from sim_bridge.robot_cell import (
    HEAD_JOINTS,
    StanceRule,
    draw_stance,
    robot_controllers,
    robot_setup,
)
from sim_bridge.robot_world import RobotWorld, Stance, finger_joint
from sim_bridge.world import TABLE_HEIGHT, WORKSPACE_EDGE

FloatArray = NDArray[np.float64]

RULE = StanceRule(random_view=True)
IMAGE = (640, 480, float(np.deg2rad(63.0)))  # columns, rows, field of view [rad]
RESOLUTION = 64  # voxels per edge of the workspace
TRUNCATION = 4.0  # [voxel]
TICK = 1.0 / 30.0  # [s]; between two looks at a motion
JAW_TIME = 0.7  # [s] of a jaw motion
PATH_TOLERANCE = 0.15  # [rad] or [m] on the way; more means that the arm is blocked
GOAL_TOLERANCE = 0.02  # [rad] or [m] at the end
SETTLE_TIME = 0.5  # [s] after the end


class Mishap(NamedTuple):
    """What the robot touched hardest, and what its joints used of their limits."""

    force: float
    link: str
    limits: dict[str, float]


class SimulatedRobot:
    """A robot at furniture, driven in lockstep; satisfies ``Hardware``.

    Args:
        robot: The robot.
        collisions: Tells its own surface from the scene's.
        scenes: What scenes are made of.
        rule: How it stands.

    Attributes:
        world: The physics.
        seen_in: The scene that the grasp was computed from; None = unknown.
        motions: Motions of an arm so far.
    """

    def __init__(
        self,
        robot: RobotModel,
        collisions: CollisionChecker,
        scenes: BridgeScenes,
        rule: StanceRule = RULE,
    ) -> None:
        self._robot, self._collisions, self._rule = robot, collisions, rule
        controllers, limits = robot_controllers(robot)
        self.world = RobotWorld(
            robot_setup(robot),
            controllers,
            limits,
            lambda furniture, seed: self._stand(furniture, seed),
            scenes,
            0.0,
            lockstep=True,
        )
        links = LinkMeshes(robot, without=HEAD_JOINTS)
        self._camera = RobotCamera(
            Intrinsics.from_hfov(*IMAGE),
            lambda q: robot.frame_pose(q, rule.camera_frame),
            Parts(links.meshes, links.poses),
        )
        self._watch = SceneWatch(TABLE_HEIGHT)
        self._revision = 0
        self.seen_in: SeenScene | None = None
        self.motions = 0

    def close(self) -> None:
        """End the physics."""
        self.world.close()

    def _stand(self, furniture: Furniture, seed: int) -> Stance:
        return draw_stance(self._robot, furniture, seed, self._rule)

    def spawn(self, kind: str, seed: int, count: int) -> tuple[str, ...]:
        """Stand at a new scene; return the objects' names."""
        return self.world.spawn(kind, seed, count)

    def look(self) -> SeenScene:
        """Fuse what the head camera sees now."""
        snapshot = self.world.snapshot
        depth = self._camera.depth(snapshot)
        top = self.world.furniture.support_height
        T_base_task = translation(*self._rule.place, top - TABLE_HEIGHT)
        T_base_camera = self._robot.frame_pose(
            snapshot.robot.q, self._rule.camera_frame
        )
        volume = integrate(
            empty_volume((RESOLUTION,) * 3, WORKSPACE_EDGE, TRUNCATION),
            depth,
            self._camera.intrinsics,
            invert(T_base_task) @ T_base_camera,
        )
        self._revision += 1
        scene = SeenScene(volume, T_base_task, self._revision, snapshot.time)
        self._watch.remember(scene)
        return scene

    @property
    def newest(self) -> SeenScene | None:
        """What was seen last."""
        return self._watch.newest

    def configuration(self) -> FloatArray:
        """Return the measured configuration, shape (J,)."""
        return np.array(self.world.snapshot.robot.q)

    def check_stop(self) -> None:
        """Let every search go on: nobody stops a round."""

    def opening(self, gripper: str) -> float:
        """Return the measured opening of jaws in [m]."""
        q, names = self.world.snapshot.robot.q, self.world.setup.joint_names
        return float(sum(q[names.index(n)] for n in self.world.setup.jaws[gripper]))

    def surroundings(self) -> Surroundings:
        """Return what is seen now, without the robot itself, and the furniture."""
        self.look()
        points = self._watch.points()
        if len(points):
            q = self.configuration()
            points = points[self._collisions.off_robot(points, q)]
        blocks = self.world.snapshot.robot.blocks
        solids = [b for b in blocks if b.name != "bin"]
        solids += [bin_.solid() for bin_ in BINS.values()]
        boxes = tuple(SolidBox(translation(*b.center), b.size) for b in solids)
        return Surroundings(points, boxes)

    def has_moved(self, T_base_gripper: FloatArray) -> bool:
        """Tell whether the thing to grasp left its place since it was seen."""
        if self.seen_in is None:
            return False
        self.look()
        return self._watch.has_moved(T_base_gripper, self.seen_in)

    def follow(self, group: str, motion: Trajectory) -> None:
        """Carry out a motion.

        Raises:
            MotionError: If no drive moves some joint, or one falls behind.
        """
        self.motions += 1
        parts: dict[str, list[int]] = {}
        owners = {j: n for n, js in self.world.controllers.items() for j in js}
        for column, joint in enumerate(motion.joint_names):
            if joint not in owners:
                raise MotionError(f"no controller for {joint}")
            parts.setdefault(owners[joint], []).append(column)

        def begin() -> None:
            for name, columns in parts.items():
                drive = self.world.drives[name]
                track = drive.read(
                    motion.times,
                    motion.positions[:, columns],
                    motion.velocities[:, columns],
                    motion.accelerations[:, columns],
                )
                drive.start(track, self.world.now)

        self.world.do(begin).result()
        self._wait(tuple(parts), motion.duration, strict=True)

    def move_jaws(self, gripper: str, opening: float) -> None:
        """Bring jaws to an opening in [m], or until they hold something."""
        name = f"gripper_{gripper}_controller"
        value = joint_at(self._robot.grippers[gripper], opening)
        assert self.world.controllers[name] == (finger_joint(gripper),)

        def begin() -> None:
            drive = self.world.drives[name]
            track = drive.read(np.array([JAW_TIME]), np.array([[value]]))
            drive.start(track, self.world.now)

        self.world.do(begin).result()
        self._wait((name,), JAW_TIME, strict=False)

    def _wait(self, names: tuple[str, ...], seconds: float, *, strict: bool) -> None:
        """Let time go on until drives are done; stop all where one falls behind."""
        end = self.world.now + seconds
        drives = [self.world.drives[name] for name in names]
        problem: list[str] = []

        def is_over() -> bool:
            over = all(drive.state is DriveState.HOLDING for drive in drives)
            behind = {name: self._behind(name) for name in names}
            worst = max(behind, key=lambda name: behind[name])
            if over and (not strict or behind[worst] < GOAL_TOLERANCE):
                return True
            late = over and self.world.now > end + SETTLE_TIME
            if strict and (late or behind[worst] > PATH_TOLERANCE):
                problem.append(f"{worst}: a joint is {behind[worst]:.3f} behind")
            return bool(problem)

        self.world.advance(TICK, is_over)
        if problem:
            self._stop(names)
            raise MotionError(problem[0])

    def _behind(self, name: str) -> float:
        measured, wanted = self.world.following(name)
        return float(np.abs(measured - wanted).max())

    def _stop(self, names: tuple[str, ...]) -> None:
        drives = [self.world.drives[name] for name in names]

        def stop() -> None:
            for drive in drives:
                drive.stop(self.world.now)

        self.world.do(stop).result()
        self.world.advance(
            TICK, lambda: all(d.state is not DriveState.STOPPING for d in drives)
        )

    def cleared(self) -> set[str]:
        """Return the names of the objects that lie in a bin."""
        snapshot = self.world.snapshot
        T = snapshot.robot.stance.T_base_world
        found = set()
        for name, model, pose in zip(
            snapshot.names, snapshot.models, snapshot.poses, strict=True
        ):
            middle = (T @ pose @ [*model.bounds().mean(axis=0), 1.0])[:3]
            for bin_ in BINS.values():
                x, y, rim = bin_.center
                away = np.abs(middle[:2] - (x, y)).max()
                if away < bin_.edge / 2 and middle[2] < rim:
                    found.add(name)
        return found

    def mishap(self) -> Mishap:
        """Return the worst of this scene so far."""
        touch, use = self.world.largest_touch, self.world.limit_use
        return Mishap(touch.force, touch.link, dict(use._asdict()))
