# SPDX-License-Identifier: Apache-2.0
"""Build scenes by the rules of the clutter-removal benchmark, and build them again.

A scene kind is a way of putting objects on the table: ``pile`` drops them into a tray,
``packed`` stands them upright side by side, ``egad`` is a pile of meshes that are sized
to the gripper, ``empty`` is the bare table.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp_ros.errors import ConfigError, UnknownNameError
from neugrasp_ros.geometry.transform import (
    make_transform,
    random_rotation,
    translation,
)
from sim_bridge.contact import BodyDynamics
from sim_bridge.objects.meshes import egad_scale
from sim_bridge.objects.model import ObjectModel
from sim_bridge.objects.registry import ObjectSet
from sim_bridge.scene import (
    SCENE_KINDS,
    PlacedObject,
    Scene,
    physical_model,
    placed_model,
)
from sim_bridge.world import TABLE_CENTER, TABLE_HEIGHT, World

FloatArray = NDArray[np.float64]

TRAY_EDGE = 0.26  # outer footprint [m]
TRAY_WALL_HEIGHT = 0.13  # [m]
TRAY_WALL_THICKNESS = 0.0039  # [m]

BENCHMARK_COUNT = 5
MEAN_EXTRA_COUNT = 4.0  # data generation draws Poisson(4) + 1 objects
DROP_RANGE = (0.10, 0.20)  # of x and y [m]
DROP_HEIGHT = 0.20  # above the table [m]
DROP_TIMEOUT = 1.0  # [s]
SCALE_RANGES = {"pile": (0.8, 1.0), "packed": (0.7, 0.9), "egad": (0.8, 1.4)}
EGAD_DYNAMICS = BodyDynamics(spinning=0.001, rolling=0.001, linear_damping=0.0)

PACKED_ATTEMPTS = 12
PACKED_RANGE = (0.08, 0.22)  # of x and y [m]
PACKED_GAP = 0.002  # above the table [m]
ASIDE = translation(0.15, 0.15, 1.0)  # where a packed object is measured


def draw_count(rng: np.random.Generator) -> int:
    """Draw how many objects a scene of the training data has."""
    return int(rng.poisson(MEAN_EXTRA_COUNT)) + 1


def build_scene(
    world: World,
    kind: str,
    objects: ObjectSet,
    names: Sequence[str],
    rng: np.random.Generator,
    *,
    count: int | None = BENCHMARK_COUNT,
    seed: int = -1,
) -> Scene:
    """Clear the world, put a table into it and objects onto the table.

    Args:
        world: Left with the scene in it; ``world.object_ids`` has the order of the
            scene's objects.
        kind: One of ``SCENE_KINDS``.
        objects: The set that the names belong to.
        names: Names to draw from, with replacement.
        rng: Source of every random choice.
        count: Objects to ask for; None draws Poisson(4) + 1. Fewer may stay.
        seed: Recorded in the scene.

    Returns:
        The objects that came to rest inside the workspace, with their poses.

    Raises:
        UnknownNameError: If the kind is unknown.
        ConfigError: If there are no names to draw from.
    """
    if kind not in SCENE_KINDS:
        raise UnknownNameError("scene kind", kind, SCENE_KINDS)
    if not names and kind != "empty":
        raise ConfigError(f"a {kind} scene needs object names, got none")
    count = draw_count(rng) if count is None else count
    world.reset()
    world.load_table()
    if kind == "packed":
        placed = _pack(world, objects, names, rng, count)
    elif kind == "empty":
        placed = {}
    else:
        placed = _drop(world, kind, objects, names, rng, count)
    return Scene(
        kind,
        seed,
        tuple(
            PlacedObject(objects.name, *placed[body], world.pose(body))
            for body in world.object_ids
        ),
    )


def rebuild_scene(
    world: World, scene: Scene, sets: Mapping[str, ObjectSet] | None = None
) -> tuple[int, ...]:
    """Clear the world and put a recorded scene into it, at rest.

    Args:
        world: The world; its objects get the order of the scene's.
        scene: The recipe.
        sets: Object sets by name; those not in it are looked up in the registry.

    Returns:
        The bodies, in the order of the scene's objects.
    """
    world.reset()
    world.load_table()
    for placed in scene.objects:
        model = physical_model(scene.kind, placed_model(placed, sets))
        _load(world, scene.kind, model, placed.T_task_object)
    return world.object_ids


def tray_walls() -> list[tuple[FloatArray, FloatArray]]:
    """Return the tray's four walls as half extents (3,) and poses (4, 4), in [m]."""
    half_height, half_thickness = TRAY_WALL_HEIGHT / 2, TRAY_WALL_THICKNESS / 2
    reach = TRAY_EDGE / 2 - half_thickness
    walls = []
    for axis in (0, 1):
        half_extents = np.array([TRAY_EDGE / 2, TRAY_EDGE / 2, half_height])
        half_extents[axis] = half_thickness
        for side in (-1.0, 1.0):
            center = np.array([*TABLE_CENTER, TABLE_HEIGHT + half_height])
            center[axis] += side * reach
            walls.append((half_extents, make_transform(np.eye(3), center)))
    return walls


def _load(
    world: World, kind: str, model: ObjectModel, T_world_object: FloatArray
) -> int:
    dynamics = EGAD_DYNAMICS if kind == "egad" else None
    return world.load_object(model, T_world_object, dynamics)


def _drop(
    world: World,
    kind: str,
    objects: ObjectSet,
    names: Sequence[str],
    rng: np.random.Generator,
    count: int,
) -> dict[int, tuple[str, float]]:
    """Let objects fall into the tray, one after the other, and take the tray away."""
    walls = [world.load_box(*wall) for wall in tray_walls()]
    placed = {}
    for name in rng.choice(np.asarray(names), size=count):
        rotation = random_rotation(rng)
        x, y = rng.uniform(*DROP_RANGE, size=2)
        scale = float(rng.uniform(*SCALE_RANGES[kind]))
        model = objects.load(str(name))
        if kind == "egad":
            scale = egad_scale(model, scale)
        pose = make_transform(rotation, np.array([x, y, TABLE_HEIGHT + DROP_HEIGHT]))
        body = _load(world, kind, physical_model(kind, model.scaled(scale)), pose)
        placed[body] = (str(name), scale)
        world.wait_for_rest(DROP_TIMEOUT)
    for wall in walls:
        world.remove(wall)
    world.clear_outside()
    return placed


def _pack(
    world: World,
    objects: ObjectSet,
    names: Sequence[str],
    rng: np.random.Generator,
    count: int,
) -> dict[int, tuple[str, float]]:
    """Stand objects upright where nothing is in the way, in at most 12 attempts."""
    placed = {}
    for _ in range(PACKED_ATTEMPTS):
        if len(world.object_ids) >= count:
            break
        name = str(rng.choice(np.asarray(names)))
        x, y = rng.uniform(*PACKED_RANGE, size=2)
        yaw = rng.uniform(0.0, 2.0 * np.pi)
        scale = float(rng.uniform(*SCALE_RANGES["packed"]))
        pose = ASIDE.copy()
        pose[:3, :3] = Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix()
        body = _stand(world, objects.load(name).scaled(scale), pose, x, y)
        if body is not None:
            placed[body] = (name, scale)
            world.clear_outside()
    return placed


def _stand(
    world: World, model: ObjectModel, pose: FloatArray, x: float, y: float
) -> int | None:
    """Put an object at (x, y) unless it touches something within one step."""
    with world.saved_state() as state:
        body = world.load_object(model, pose)
        lower, upper = world.bounds(body)
        pose = pose.copy()
        pose[:3, 3] = x, y, TABLE_HEIGHT + (upper[2] - lower[2]) / 2 + PACKED_GAP
        world.set_pose(body, pose)
        world.step()
        if world.has_contact(body):
            world.remove(body)
            world.restore(state)
            return None
    return body
