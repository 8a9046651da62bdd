# SPDX-License-Identifier: Apache-2.0
"""Whether a configuration hits the robot itself or the scene."""

from collections.abc import Callable
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import RobotModelError, ShapeError
from neugrasp_ros.robot.bodies import (
    Hulls,
    body_balls,
    body_poses,
    join_hulls,
    joint_tree,
    robot_hulls,
)
from neugrasp_ros.robot.contact import (
    FREE,
    SELF,
    Scope,
    path_contacts,
)
from neugrasp_ros.robot.model import RobotModel
from neugrasp_ros.robot.obstacles import Obstacles, make_obstacles
from neugrasp_ros.robot.posing import World

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Contact(NamedTuple):
    """Two things that touch, by link name; ``scene`` stands for all obstacles."""

    first: str
    second: str


class CollisionChecker:
    """Convex hulls of all links against each other and against obstacles.

    Only pairs whose distance the asked group can change are looked at. A link and its
    parent may touch, and so may the pairs that the description excludes.

    Attributes:
        robot: The robot.
        links: Link of each hull.
        pairs: Hulls that must not touch each other, shape (P, 2).
    """

    def __init__(
        self,
        robot: RobotModel,
        *,
        padding: float = 0.003,
        jaw_padding: float = 0.001,
        check_self: bool = True,
        self_padding: float | None = None,
    ) -> None:
        """Collect hulls and pairs.

        Args:
            robot: The robot.
            padding: Distance that links keep from each other and the scene in [m].
            jaw_padding: Distance that the hand in use keeps from the scene in [m].
            check_self: Look at the robot's own links at all.
            self_padding: Distance that links keep from each other in [m]; default
                ``padding``.

        Raises:
            RobotModelError: If an excluded pair names a link that does not exist.
        """
        self.robot = robot
        self._tree = joint_tree(robot)
        self._hulls, self.links = robot_hulls(robot)
        self._balls = body_balls(self._hulls, len(robot.joint_names))
        self._padding, self._jaw_padding = padding, jaw_padding
        self._self_padding = padding if self_padding is None else self_padding
        self.pairs = self._find_pairs()[: None if check_self else 0]
        self._nothing = make_obstacles()
        self._scopes: dict[str, Scope] = {}

    def with_hull(
        self, hull: Hulls, link: str, may_touch: Callable[[str], bool]
    ) -> "CollisionChecker":
        """Return a checker of the same robot with one more hull; this one stays.

        Args:
            hull: The hull alone.
            link: Its name in contacts.
            may_touch: Tells of a link's name whether the hull may touch it; those on
                the same body may, too.
        """
        other, number = copy(self), len(self.links)
        other._hulls = join_hulls(self._hulls, hull)
        other.links = (*self.links, link)
        other._balls = body_balls(other._hulls, len(self.robot.joint_names))
        other._scopes = {}
        pairs = [
            (g, number)
            for g, name in enumerate(self.links)
            if self._hulls.bodies[g] != hull.bodies[0] and not may_touch(name)
        ]
        if len(self.pairs):  # links are looked at at all
            more = np.array(pairs, dtype=np.int64).reshape(-1, 2)
            other.pairs = np.concatenate([self.pairs, more])
        return other

    def codes(
        self,
        configurations: FloatArray,
        group: str = "",
        obstacles: Obstacles | None = None,
    ) -> IntArray:
        """Return ``FREE``, ``SELF``, ``SCENE`` or ``HAND`` for configurations (N, J).

        Args:
            configurations: Joint values in the robot's order, shape (N, J).
            group: Planning group that moves; empty = every joint.
            obstacles: The scene, if any.

        Raises:
            ShapeError: If the configurations are not (N, J).
        """
        return self._ask(configurations, group, obstacles)[0]

    def first_contact(
        self, q: FloatArray, group: str = "", obstacles: Obstacles | None = None
    ) -> Contact | None:
        """Return what touches what in a configuration (J,), or None."""
        codes, which = self._ask(np.asarray(q)[None], group, obstacles)
        if codes[0] == FREE:
            return None
        if codes[0] == SELF:
            i, j = self.scope(group).pairs[which[0]]
            return Contact(self.links[i], self.links[j])
        return Contact(self.links[which[0]], "scene")

    def path_codes(
        self,
        paths: FloatArray,
        starts: FloatArray,
        group: str,
        *,
        obstacles: Obstacles | None = None,
        held: FloatArray | None = None,
    ) -> IntArray:
        """Return the first contact along each of N paths.

        Args:
            paths: Joint values of the group, shape (N, S, n).
            starts: Configurations that hold all other joints, shape (N, J).
            group: Planning group that moves.
            obstacles: The scene, if any.
            held: For each path a ball, centre and radius in [m], whose points travel
                with the hand, shape (N, 4).
        """
        joints = self.robot.group_indices(group)
        return self._ask(starts, group, obstacles, (joints, paths), held)[0]

    def off_robot(
        self, points_base: FloatArray, q: FloatArray, margin: float = 0.02
    ) -> NDArray[np.bool_]:
        """Return which points (M, 3) are not the robot's own surface, shape (M,).

        Args:
            points_base: Points in the base frame in [m].
            q: Configuration in which they were seen, shape (J,).
            margin: Distance up to which a point belongs to a link in [m].
        """
        joints, hulls = len(q), self._hulls
        rotations, positions = np.empty((joints + 1, 3, 3)), np.empty((joints + 1, 3))
        body_poses(self._tree, np.asarray(q, dtype=float), rotations, positions)
        off = np.ones(len(points_base), dtype=bool)
        for g, body in enumerate(hulls.bodies):
            R, p = rotations[body], positions[body]
            near = np.linalg.norm(points_base - (R @ hulls.centers[g] + p), axis=1)
            rows = np.flatnonzero(off & (near < hulls.radii[g] + margin))
            faces = hulls.faces[hulls.face_starts[g] : hulls.face_starts[g + 1]]
            heights = (points_base[rows] - p) @ R @ faces[:, :3].T - faces[:, 3]
            off[rows] = (heights > margin).any(axis=1)
        return off

    def _ask(
        self,
        starts: FloatArray,
        group: str,
        obstacles: Obstacles | None,
        paths: tuple[IntArray, FloatArray] | None = None,
        held: FloatArray | None = None,
    ) -> tuple[IntArray, IntArray]:
        """Return code and number of the first contact on each path, or at its start."""
        joints = len(self.robot.joint_names)
        if starts.ndim != 2 or starts.shape[1] != joints:
            raise ShapeError("configurations", f"(N, {joints})", starts.shape)
        moving, values = paths or (np.zeros(0, np.int64), np.zeros((len(starts), 1, 0)))
        found = np.zeros((len(starts), 2), dtype=np.int64)
        path_contacts(
            self.world(obstacles),
            self.scope(group),
            np.ascontiguousarray(starts, dtype=np.float64),
            moving,
            np.ascontiguousarray(values),
            np.zeros((len(starts), 4)) if held is None else held,
            found,
        )
        return found[:, 0], found[:, 1]

    def world(self, obstacles: Obstacles | None) -> World:
        """Return the robot and what is around it as compiled code takes it."""
        around = obstacles or self._nothing
        return World(self._tree, self._hulls, self._balls, around)

    def _find_pairs(self) -> IntArray:
        bodies = self._hulls.bodies
        parents = self._tree.parents
        excluded = set()
        for pair in self.robot.description.self_collision_exclusions:
            for name in pair:
                if name not in self.robot.frame_names:
                    raise RobotModelError("frame", name, self.robot.frame_names)
            excluded |= {tuple(pair), tuple(reversed(pair))}
        slides = self._finger_bodies()
        found = []
        for i, j in zip(*np.triu_indices(len(bodies), 1), strict=True):
            a, b = bodies[i], bodies[j]
            neighbours = a == b or parents[a] == b and a >= 0
            neighbours |= b >= 0 and parents[b] == a
            opposite = a in slides and b in slides and parents[a] == parents[b]
            if not (
                neighbours or opposite or (self.links[i], self.links[j]) in excluded
            ):
                found.append((i, j))
        return np.array(found, dtype=np.int64).reshape(-1, 2)

    def _finger_bodies(self) -> set[int]:
        """Bodies of our own sliding fingers; a pair of jaws may close."""
        names = self.robot.joint_names
        return {k for k, name in enumerate(names) if name.endswith("_slide_joint")}

    def scope(self, group: str) -> Scope:
        """Return what a planning group can bring into contact."""
        if group not in self._scopes:
            self._scopes[group] = self._make_scope(group)
        return self._scopes[group]

    def _make_scope(self, group: str) -> Scope:
        everything = np.arange(len(self.robot.joint_names))
        active = set(self.robot.group_indices(group) if group else everything)
        # joints of the group on the way from the base to each hull
        ways = [active & self._ancestors(body) for body in self._hulls.bodies]
        pairs = np.array(
            [(i, j) for i, j in self.pairs if ways[i] ^ ways[j]], dtype=np.int64
        ).reshape(-1, 2)
        bodies = np.where(self._hulls.bodies < 0, len(everything), self._hulls.bodies)
        pairs = pairs[np.lexsort(bodies[pairs].T)]
        body_pairs, starts = np.unique(bodies[pairs], axis=0, return_index=True)
        order = np.argsort(starts)
        movers = np.array([g for g, way in enumerate(ways) if way], dtype=np.int64)
        key = self.robot.description.groups[group].gripper if group else ""
        hand = np.array(
            [bool(key) and self.links[g].startswith(f"gripper_{key}_") for g in movers]
        )
        return Scope(
            pairs=pairs,
            body_pairs=body_pairs[order],
            pair_starts=np.append(starts[order], len(pairs)),
            movers=movers,
            padding=np.where(hand, self._jaw_padding, self._padding),
            hand=hand.astype(np.bool_),
            self_padding=self._self_padding,
        )

    def _ancestors(self, body: int) -> set[int]:
        found = set()
        while body >= 0:
            found.add(int(body))
            body = self._tree.parents[body]
        return found
