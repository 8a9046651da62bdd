# SPDX-License-Identifier: Apache-2.0
"""A physics world: a table, objects on it, steps, contacts, and saved states."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pybullet
from numpy.typing import NDArray

from neugrasp_ros.errors import SimulationError
from neugrasp_ros.geometry.transform import make_transform
from sim_bridge.bodies import pose_tuple, transform_from, write_object_urdf
from sim_bridge.contact import BodyDynamics, Contact
from sim_bridge.objects.model import ObjectModel

FloatArray = NDArray[np.float64]

TIME_STEP = 1.0 / 240.0  # [s]
TABLE_HEIGHT = 0.05  # [m], the top face
TABLE_CENTER = (0.15, 0.15)  # [m]
TABLE_SIZE = (1.2, 1.2, 0.012)  # [m]
TABLE_FRICTION = 0.5
WORKSPACE_EDGE = 0.30  # [m]
REST_NORM = 0.01  # stacked linear and angular velocity, [m/s] and [rad/s]
REST_CHECK_STEPS = 60  # a quarter of a second between two looks

OBJECT_FLAGS = pybullet.URDF_USE_IMPLICIT_CYLINDER
FAST_ITERATIONS = 80  # of labels: see `neugrasp agreement`
BENCHMARK_ITERATIONS = 150


class World:
    """One simulated workspace with its own engine connection.

    Args:
        solver_iterations: Constraint solver iterations per step.
        sleeping: Let objects at rest fall asleep until something touches them.
        rigid_objects: Simulate objects as plain rigid bodies. The benchmark has them
            as articulated bodies without joints, whose contacts cost twice the time.
    """

    def __init__(
        self,
        *,
        solver_iterations: int = BENCHMARK_ITERATIONS,
        sleeping: bool = False,
        rigid_objects: bool = False,
    ) -> None:
        self.client = pybullet.connect(pybullet.DIRECT)
        if self.client < 0:
            raise SimulationError("the physics engine has no free connection")
        self.sleeping = sleeping
        self._rigid_objects = rigid_objects
        self._folder = tempfile.TemporaryDirectory(prefix="neugrasp_world_")
        self._iterations = solver_iterations
        self.table: int | None = None
        self.reset()

    def __enter__(self) -> "World":
        """Return the world itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the connection."""
        self.close()

    def close(self) -> None:
        """Disconnect and delete temporary files; closing twice is harmless."""
        if self.client >= 0:
            pybullet.disconnect(physicsClientId=self.client)
            self._folder.cleanup()
            self.client = -1

    def reset(self) -> None:
        """Remove everything and set the engine's parameters."""
        pybullet.resetSimulation(physicsClientId=self.client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP,
            numSolverIterations=self._iterations,
            enableFileCaching=0,
            physicsClientId=self.client,
        )
        pybullet.setGravity(0.0, 0.0, -9.81, physicsClientId=self.client)
        self._models: dict[int, ObjectModel] = {}
        self.table = None
        self.steps = 0

    @property
    def solver_iterations(self) -> int:
        """Constraint solver iterations per step."""
        return self._iterations

    @solver_iterations.setter
    def solver_iterations(self, value: int) -> None:
        self._iterations = value
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=value, physicsClientId=self.client
        )

    @property
    def object_ids(self) -> tuple[int, ...]:
        """Bodies of the objects, in the order of their loading."""
        return tuple(self._models)

    def model(self, body: int) -> ObjectModel:
        """Return what was loaded as ``body``, at its physical scale."""
        return self._models[body]

    def scratch_path(self, name: str) -> Path:
        """Return a path for a temporary file that goes when the world closes."""
        return Path(self._folder.name) / name

    def load_urdf(
        self,
        path: Path,
        *,
        position: Sequence[float],
        quaternion: Sequence[float],
        flags: int = OBJECT_FLAGS,
        fixed: bool = False,
        rigid: bool = False,
    ) -> int:
        """Load a URDF whose link frame gets the given pose.

        Args:
            path: The file.
            position: In the world in [m], shape (3,).
            quaternion: In the world, xyzw.
            flags: The engine's flags for loading.
            fixed: Bolt the base to the world.
            rigid: One link as a plain rigid body.

        Raises:
            SimulationError: If the engine refuses the file.
        """
        try:
            return int(
                pybullet.loadURDF(
                    str(path),
                    position,
                    quaternion,
                    useFixedBase=fixed,
                    useMaximalCoordinates=rigid,
                    flags=flags,
                    physicsClientId=self.client,
                )
            )
        except pybullet.error as error:
            raise SimulationError(f"the physics engine refused {path}") from error

    def load_table(self) -> int:
        """Load the table, its top at ``TABLE_HEIGHT``; return its body."""
        center = make_transform(
            np.eye(3), np.array([*TABLE_CENTER, TABLE_HEIGHT - TABLE_SIZE[2] / 2])
        )
        self.table = self.load_box(np.asarray(TABLE_SIZE) / 2, center)
        return self.table

    def load_box(
        self,
        half_extents: FloatArray,
        T_world_box: FloatArray,
        friction: float = TABLE_FRICTION,
    ) -> int:
        """Load a static box with half extents (3,) in [m]; return its body."""
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX,
            halfExtents=list(half_extents),
            physicsClientId=self.client,
        )
        position, quaternion = pose_tuple(T_world_box)
        body = pybullet.createMultiBody(
            0.0,
            shape,
            basePosition=position,
            baseOrientation=quaternion,
            flags=pybullet.URDF_ENABLE_SLEEPING * self.sleeping,
            physicsClientId=self.client,
        )
        self.change_dynamics(body, lateralFriction=friction)
        return int(body)

    def load_object(
        self,
        model: ObjectModel,
        T_world_object: FloatArray,
        dynamics: BodyDynamics | None = None,
    ) -> int:
        """Load an object at a pose; the engine computes its inertia.

        Args:
            model: The object at the scale it shall have.
            T_world_object: Pose of the object's frame, shape (4, 4).
            dynamics: Contact values; default the model's friction and no rolling.

        Returns:
            The body.

        Raises:
            SimulationError: If the engine refuses the object.
        """
        dynamics = dynamics or BodyDynamics()
        path = write_object_urdf(model, Path(self._folder.name), "object")
        position, quaternion = pose_tuple(T_world_object)
        flags = OBJECT_FLAGS | pybullet.URDF_ENABLE_SLEEPING * self.sleeping
        try:
            body = self.load_urdf(
                path,
                position=position,
                quaternion=quaternion,
                flags=flags,
                rigid=self._rigid_objects,
            )
        except SimulationError as error:
            raise SimulationError(
                f"the physics engine refused object {model.set_name}/{model.name}"
            ) from error
        friction = model.friction if dynamics.friction is None else dynamics.friction
        values: dict[str, Any] = {
            "lateralFriction": friction,
            "spinningFriction": dynamics.spinning,
            "rollingFriction": dynamics.rolling,
        }
        if dynamics.linear_damping is not None:
            values["linearDamping"] = dynamics.linear_damping
        self.change_dynamics(body, **values)
        self._models[body] = model
        return body

    def change_dynamics(self, body: int, *, link: int = -1, **values: Any) -> None:
        """Set the engine's contact values of one link by their engine names."""
        pybullet.changeDynamics(body, link, physicsClientId=self.client, **values)

    def remove(self, body: int) -> None:
        """Remove a body."""
        pybullet.removeBody(body, physicsClientId=self.client)
        self._models.pop(body, None)

    def center_of_mass(self, body: int) -> FloatArray:
        """Return where a body's base has its centre of mass in [m], shape (3,)."""
        position, _ = pybullet.getBasePositionAndOrientation(
            body, physicsClientId=self.client
        )
        return np.array(position)

    def pose(self, body: int) -> FloatArray:
        """Return ``T_world_object`` of an object, shape (4, 4)."""
        position, quaternion = pybullet.getBasePositionAndOrientation(
            body, physicsClientId=self.client
        )
        T_world_object = transform_from(position, quaternion)
        center = self._models[body].center_of_mass
        T_world_object[:3, 3] -= T_world_object[:3, :3] @ center
        return T_world_object

    def set_pose(self, body: int, T_world_object: FloatArray) -> None:
        """Put an object at a pose, at rest."""
        center = self._models[body].center_of_mass
        position, quaternion = pose_tuple(T_world_object, center)
        pybullet.resetBasePositionAndOrientation(
            body, position, quaternion, physicsClientId=self.client
        )
        pybullet.resetBaseVelocity(
            body, [0.0] * 3, [0.0] * 3, physicsClientId=self.client
        )

    def put_to_sleep(self) -> None:
        """Let everything sleep until something touches it, the table included.

        A sleeping object costs nothing only while what it lies on sleeps, too.
        """
        statics = [] if self.table is None else [self.table]
        for body in [*statics, *self._models]:
            self.change_dynamics(body, activationState=pybullet.ACTIVATION_STATE_SLEEP)

    def velocity(self, body: int) -> FloatArray:
        """Return linear [m/s] and angular [rad/s] velocity, shape (6,)."""
        linear, angular = pybullet.getBaseVelocity(body, physicsClientId=self.client)
        return np.array([*linear, *angular])

    def bounds(self, body: int) -> FloatArray:
        """Return the engine's box around a body in [m], shape (2, 3)."""
        return np.array(pybullet.getAABB(body, physicsClientId=self.client))

    def step(self, count: int = 1) -> None:
        """Advance time by ``count`` steps of ``TIME_STEP``."""
        for _ in range(count):
            pybullet.stepSimulation(physicsClientId=self.client)
        self.steps += count

    def wait_for_rest(self, timeout: float = 2.0) -> bool:
        """Step until every object is at rest or ``timeout`` [s] has passed.

        Returns:
            True if everything came to rest in time.
        """
        elapsed = 0.0
        while elapsed < timeout:
            self.step(REST_CHECK_STEPS)
            elapsed += REST_CHECK_STEPS * TIME_STEP
            if all(np.linalg.norm(self.velocity(b)) <= REST_NORM for b in self._models):
                return True
        return False

    def clear_outside(self) -> tuple[int, ...]:
        """Wait for rest and remove what left the workspace, until nothing does.

        Returns:
            The bodies that were removed.
        """
        removed: list[int] = []
        while True:
            self.wait_for_rest()
            outside = [
                body
                for body in self._models
                if not _is_inside(self.center_of_mass(body))
            ]
            if not outside:
                return tuple(removed)
            for body in outside:
                self.remove(body)
            removed += outside

    @contextmanager
    def saved_state(self) -> Iterator[int]:
        """Save the state of all bodies in memory; freed when the block ends.

        Constraints and motor targets are not part of it.

        Yields:
            The handle that ``restore`` takes.
        """
        state = pybullet.saveState(physicsClientId=self.client)
        try:
            yield state
        finally:
            pybullet.removeState(state, physicsClientId=self.client)

    def restore(self, state: int) -> None:
        """Bring all bodies back to a saved state; there must be the same bodies.

        Raises:
            SimulationError: If the bodies differ from the saved ones.
        """
        try:
            pybullet.restoreState(stateId=state, physicsClientId=self.client)
        except pybullet.error as error:
            raise SimulationError(
                "the state was saved with other bodies than there are now"
            ) from error

    def detect_collisions(self) -> None:
        """Bring the contacts up to date without moving anything."""
        pybullet.performCollisionDetection(physicsClientId=self.client)

    def has_contact(self, body: int) -> bool:
        """Tell whether the last step or detection found any contact of ``body``."""
        return bool(pybullet.getContactPoints(body, physicsClientId=self.client))

    def contacts(self, body_a: int, body_b: int | None = None) -> list[Contact]:
        """Return the contacts of a body, or of a pair of bodies."""
        arguments = [body_a] if body_b is None else [body_a, body_b]
        points = pybullet.getContactPoints(*arguments, physicsClientId=self.client)
        return [Contact(p[1], p[3], p[2], p[4], p[8], p[9]) for p in points]


def _is_inside(position: FloatArray) -> bool:
    return bool(((position >= 0.0) & (position <= WORKSPACE_EDGE)).all())
