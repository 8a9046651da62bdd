# SPDX-License-Identifier: Apache-2.0
"""What the robot's own camera and a bystander see: objects, furniture, the robot."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.camera import Intrinsics
from neugrasp_ros.geometry.mesh import Mesh, box_mesh
from neugrasp_ros.geometry.raycast import MeshScene, RayHits
from neugrasp_ros.geometry.transform import invert, look_at, translation
from sim_bridge.bridge_camera import STILL, BridgeCamera
from sim_bridge.bridge_world import Snapshot
from sim_bridge.furniture import Block
from sim_bridge.scene import posed_meshes

FloatArray = NDArray[np.float64]

BLOCK_BODY = -2  # id of all furniture in segmentations
ROBOT_BODY = -3
STANDPOINT = np.array([1.75, -1.45, 1.65])  # of the bystander, in the base frame [m]
LOOKED_AT = np.array([0.38, 0.0, 0.76])
TORSO = np.array([0.25, 0.0, 1.0])  # the bystander shall see it, too
LIGHT = np.array([0.35, -0.45, 1.0]) / np.linalg.norm([0.35, -0.45, 1.0])
AMBIENT, SHADE = 0.45, 0.55  # of the brightness, without light and in the shadow
FLOOR = (0.80, 0.80, 0.78)
SKY = (0.93, 0.95, 0.97)
OBJECT_COLORS = np.array(
    [[0.84, 0.24, 0.20], [0.20, 0.55, 0.80], [0.95, 0.70, 0.15], [0.30, 0.65, 0.35],
     [0.60, 0.35, 0.70], [0.90, 0.45, 0.10]]
)  # fmt: skip
SUPERSAMPLING = 2


class Parts(NamedTuple):
    """A robot as meshes: what they are, and where they are in a configuration."""

    meshes: Sequence[Mesh]
    poses: Callable[[FloatArray], FloatArray]


class RobotCamera(BridgeCamera):
    """The camera in the robot's head.

    Args:
        intrinsics: The camera.
        camera_pose: Returns ``T_base_camera`` for a configuration.
        parts: The robot without its head.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        camera_pose: Callable[[FloatArray], FloatArray],
        parts: Parts,
    ) -> None:
        super().__init__(intrinsics, np.eye(4))
        self._camera_pose, self._parts = camera_pose, parts

    def is_still(self, before: Snapshot, now: Snapshot) -> bool:
        """Tell whether neither objects nor robot moved."""
        return super().is_still(before, now) and bool(
            before.robot.blocks is now.robot.blocks
            and (np.abs(before.robot.q - now.robot.q) < STILL).all()
        )

    def _view(self, snapshot: Snapshot) -> RayHits:
        robot = snapshot.robot
        scene = _scene(snapshot, self._parts, robot.blocks)
        T_world_base = invert(robot.stance.T_base_world)
        return scene.view(self.intrinsics, T_world_base @ self._camera_pose(robot.q))


class Bystander:
    """Takes pictures of the robot at work.

    Args:
        parts: The robot.
        colors: Of its parts, 0..1, shape (B, 3).
        width: Columns [pixel].
        height: Rows [pixel].
    """

    def __init__(
        self, parts: Parts, colors: FloatArray, width: int = 480, height: int = 360
    ) -> None:
        self._parts, self._colors = parts, colors
        self._size = (height, width)
        self._intrinsics = Intrinsics.from_hfov(
            width * SUPERSAMPLING, height * SUPERSAMPLING, float(np.deg2rad(44.0))
        )

    def photo(self, snapshot: Snapshot) -> NDArray[np.uint8]:
        """Return a picture, shape (H, W, 3)."""
        robot = snapshot.robot
        floor = Block(
            "floor", np.array([0.5, 0.0, -0.01]), np.array([9.0, 9.0, 0.02]), FLOOR
        )
        blocks = (*open_to_view(robot.blocks), floor)
        scene = _scene(snapshot, self._parts, blocks, one_id_each=True)
        T_world_base = invert(robot.stance.T_base_world)
        T = T_world_base @ look_at(STANDPOINT, LOOKED_AT)
        hits = scene.view(self._intrinsics, T)
        owners = [i for i, m in enumerate(snapshot.models) for _ in m.visuals]
        colors = np.concatenate(
            [
                OBJECT_COLORS[np.array(owners, dtype=int) % len(OBJECT_COLORS)],
                self._colors,
                np.array([block.color for block in blocks]),
                [SKY],
            ]
        )
        light = T_world_base[:3, :3] @ LIGHT
        bright = _brightness(scene, hits, self._intrinsics, T, light)
        picture = colors[hits.bodies] * np.where(hits.bodies < 0, 1.0, bright)[:, None]
        height, width = self._size
        n = SUPERSAMPLING
        picture = picture.reshape(height, n, width, n, 3).mean(axis=(1, 3))
        return np.asarray(np.clip(picture * 255, 0, 255).astype(np.uint8))


def open_to_view(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """Return the blocks without those between the bystander and the robot's work.

    Args:
        blocks: What stands around, first what the objects stand on.
    """
    support = blocks[0]
    work = support.center + [0.0, 0.0, support.size[2] / 2 + 0.05]
    walls = [
        any(_is_between(block, target) for target in (work, TORSO)) for block in blocks
    ]
    return tuple(b for b, wall in zip(blocks, walls, strict=True) if not wall)


def _is_between(block: Block, target: FloatArray) -> bool:
    """Tell whether a block cuts the line from the bystander to a point (3,)."""
    way = target - STANDPOINT
    with np.errstate(divide="ignore"):
        sides = (block.center - STANDPOINT + np.outer([-0.5, 0.5], block.size)) / way
    enter, leave = sides.min(axis=0).max(), sides.max(axis=0).min()
    return bool(max(enter, 0.0) < min(leave, 1.0))


def _brightness(
    scene: MeshScene, hits: RayHits, intrinsics: Intrinsics, T: FloatArray, light: Any
) -> FloatArray:
    """Return how bright each pixel is, with the shadows of one lamp, shape (R,)."""
    facing = np.clip(hits.normals @ light, 0.0, 1.0)
    rays = intrinsics.ray_directions().reshape(-1, 3) @ T[:3, :3].T
    met = np.isfinite(hits.distances)
    lit = np.zeros(len(rays))
    points = T[:3, 3] + rays[met] * hits.distances[met][:, None]
    points = points + 2e-3 * hits.normals[met]
    shadow = scene.cast(points, np.tile(light, (len(points), 1)))
    lit[met] = np.where(np.isfinite(shadow.distances), 1.0 - SHADE, 1.0)
    return np.asarray(AMBIENT + (1.0 - AMBIENT) * facing * lit)


def _scene(
    snapshot: Snapshot,
    parts: Parts,
    blocks: Sequence[Block],
    *,
    one_id_each: bool = False,
) -> MeshScene:
    """Return everything in the world's frame; objects come first."""
    robot = snapshot.robot
    objects = posed_meshes(list(snapshot.models), list(snapshot.poses))
    T_world_base = invert(robot.stance.T_base_world)
    boxes = [box_mesh(block.size / 2) for block in blocks]
    places = np.array([T_world_base @ translation(*b.center) for b in blocks])
    meshes = [*objects.meshes, *parts.meshes, *boxes]
    poses = [objects.poses, T_world_base @ parts.poses(robot.q), places]
    ids = [*objects.body_ids, *[ROBOT_BODY] * len(parts.meshes)]
    ids += [BLOCK_BODY] * len(boxes)
    if one_id_each:
        ids = list(range(len(meshes)))
    return MeshScene(meshes, np.concatenate(poses), ids)
