# SPDX-License-Identifier: Apache-2.0
"""Labelled grasps as the network itself sees them.

Local surfaces are rendered from the network's own occupancy field, never from the
truth: a detector trained on true surfaces meets other ones at work (learning sheet, 2).
"""

import logging
import os
import time
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch
from numpy.typing import NDArray

from neugrasp_ros.config import RenderConfig
from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.datagen.pool import process_pool
from neugrasp_ros.errors import ShardError
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import pose_from
from neugrasp_ros.grasp.inputs import LocalInputs, assemble_inputs
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.field import evaluate_field
from neugrasp_ros.scene.network import SceneNetwork
from neugrasp_ros.training.cache import POINT_SCALE
from neugrasp_ros.training.views import (
    EDGE,
    TABLE_TOP,
    ViewRange,
    object_scene,
    quantise,
    random_camera,
    render_volume,
    table_scene,
)
from sim_bridge.objects.affordance import SET_NAME as AFFORDANCE_SET
from sim_bridge.objects.affordances import AFFORDANCES
from sim_bridge.objects.grasp_labels import nearest_classes, scene_class_points
from sim_bridge.scene import Scene, placed_model

LOGGER = logging.getLogger(__name__)

REPORT_SECONDS = 15.0
LOCAL_NOISE = 0.003  # [m], spread of the points of the local occupancy loss
NOT_KNOWN = 255  # of an affordance
COLLISION_SHARE = 0.25  # of grasps that collide at once, to the others of a scene
LEAST_COLLISIONS = 12  # that stay anyway: what a scene had before there could be more
PART_REACH = 0.008  # [m], how far from a part a point may be and still be its


@dataclass(frozen=True, eq=False)
class GraspEntry:
    """One view of one scene, and its grasps.

    Attributes:
        volume: Quantised distances, shape (D, D, D).
        points: Local surface points in units of the edge times 65535, (G, P, 3).
        point_features: Shape (G, P, POINT_FEATURES).
        tokens: Shape (G, TOKEN_FEATURES).
        labels: 1 = success, shape (G,).
        judged: Whether it succeeds is known, shape (G,).
        tried: Went through physics, shape (G,).
        affordances: 1 = affords the class, 0 = does not, ``NOT_KNOWN``, shape (G, A).
        poses: Poses ``T_task_gripper``, shape (G, 4, 4).
        local_points: Points near the local surfaces, scaled like ``points``, (M, 3).
        local_occupied: Whether they are inside an object, shape (M,).
        local_classes: What the nearest part affords: 1, 0, or ``NOT_KNOWN`` where no
            labelled part is near, shape (M, A).
    """

    volume: NDArray[np.int8]
    points: NDArray[np.uint16]
    point_features: NDArray[np.float16]
    tokens: NDArray[np.float32]
    labels: NDArray[np.uint8]
    judged: NDArray[np.bool_]
    tried: NDArray[np.bool_]
    affordances: NDArray[np.uint8]
    poses: NDArray[np.float32]
    local_points: NDArray[np.uint16]
    local_occupied: NDArray[np.bool_]
    local_classes: NDArray[np.uint8]


@torch.no_grad()
def view_grasps(
    labels: SceneLabels,
    network: SceneNetwork,
    rng: np.random.Generator,
    *,
    views: ViewRange | None = None,
    camera: NDArray[np.float64] | None = None,
    threads: int = 1,
) -> GraspEntry | None:
    """Look at a labelled scene once, as the network at work does.

    Args:
        labels: The scene and its grasps.
        network: Gives the occupancy field that local surfaces are rendered from.
        rng: Draws the view, its noise, and the local occupancy points.
        views: From where, and with which noise.
        camera: Pose ``T_task_camera`` to look from instead, shape (4, 4).
        threads: Worker threads.

    Returns:
        None if no grasp meets a surface that the network has completed.
    """
    views = views or ViewRange()
    camera = random_camera(views, rng) if camera is None else camera
    distances = render_volume(table_scene(labels.scene), camera, views, rng)
    channels = torch.from_numpy(volume_channels(distances))[None]
    planes = network.encode(channels)
    field, _ = evaluate_field(network, planes, distances, EDGE)
    render = RenderConfig()
    grasps = labels.grasps
    inputs, _ = assemble_inputs(
        field,
        distances,
        pose_from(
            grasps.positions.astype(np.float64), grasps.quaternions.astype(np.float64)
        ),
        grasps.openings.astype(np.float64),
        labels.gripper,
        n_points=network.config.local_points,
        image_size=render.local_image_size,
        fov=np.deg2rad(render.local_fov_deg),
        support_height=TABLE_TOP,
        threads=threads,
    )
    kept = inputs.hits > 0
    if not kept.any():
        return None
    return _entry(labels, distances, inputs, kept, object_scene(labels.scene), rng)


def _entry(
    labels: SceneLabels,
    distances: NDArray[np.float32],
    inputs: LocalInputs,
    kept: NDArray[np.bool_],
    truth: MeshScene,
    rng: np.random.Generator,
) -> GraspEntry:
    surface = inputs.points_task[kept]
    local = surface[:, :: max(1, surface.shape[1] // 32)].reshape(-1, 3)
    local = np.clip(local + rng.normal(0, LOCAL_NOISE, local.shape), 0, EDGE)
    return GraspEntry(
        quantise(distances),
        _scaled(surface),
        inputs.point_features[kept].astype(np.float16),
        inputs.tokens[kept],
        labels.grasps.labels[kept],
        labels.grasps.judged()[kept],
        labels.grasps.tried[kept],
        affordance_targets(labels)[kept],
        labels.grasps.poses()[kept].astype(np.float32),
        _scaled(local),
        truth.contains(local.astype(np.float64)),
        part_targets(labels.scene, local.astype(np.float64), rng),
    )


def part_targets(
    scene: Scene, points_task: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """Return what the part at each point affords, shape (N, A).

    Args:
        scene: The recipe.
        points_task: In [m], shape (N, 3).
        rng: Source of randomness.

    Returns:
        1, 0, or ``NOT_KNOWN`` where no labelled part is within ``PART_REACH``.
    """
    if not any(item.set_name == AFFORDANCE_SET for item in scene.objects):
        return np.full((len(points_task), len(AFFORDANCES)), NOT_KNOWN, dtype=np.uint8)
    surface = scene_class_points(
        [placed_model(item) for item in scene.objects],
        [item.T_task_object for item in scene.objects],
        rng,
    )
    classes, near = nearest_classes(surface, points_task, PART_REACH)
    return np.where(near[:, None], classes.astype(np.uint8), np.uint8(NOT_KNOWN))


def affordance_targets(labels: SceneLabels) -> NDArray[np.uint8]:
    """Return what the affordance heads learn from a scene, shape (G, A).

    A class is 1, 0, or ``NOT_KNOWN``.
    """
    known = known_affordances(labels)[:, None]
    return np.where(known, labels.grasps.affordances, np.uint8(NOT_KNOWN))


def known_affordances(labels: SceneLabels) -> NDArray[np.bool_]:
    """Tell of which grasps of a scene it is known what they afford, shape (G,).

    The heads predict what a grasp is good for *given that it holds*, which the ranking
    multiplies by the probability that it does. What that would be is told by the parts
    between the jaws, so failed and untried grasps teach it as well where they hold any
    such part. A scene without a labelled object says nothing: a plain cylinder is
    shaped like a mug's body.
    """
    grasps = labels.grasps
    labelled = any(item.set_name == AFFORDANCE_SET for item in labels.scene.objects)
    if not (labelled or grasps.affordances.any()):
        return np.zeros(len(grasps), dtype=bool)
    return np.asarray((grasps.labels > 0) | grasps.affordances.any(axis=1))


def _scaled(points: NDArray[np.floating]) -> NDArray[np.uint16]:
    return np.round(np.clip(points / EDGE, 0, 1) * POINT_SCALE).astype(np.uint16)


def save_grasps(entry: GraspEntry, path: Path) -> None:
    """Write an entry; the file appears only when it is whole."""
    part = path.with_suffix(".part")
    with part.open("wb") as stream:
        np.savez(stream, **{f.name: getattr(entry, f.name) for f in fields(entry)})
    os.replace(part, path)


def load_grasps(path: Path) -> GraspEntry:
    """Read an entry.

    Raises:
        ShardError: If the file is damaged or lacks a part.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            return GraspEntry(**{f.name: file[f.name] for f in fields(GraspEntry)})
    except (KeyError, ValueError, OSError, EOFError, BadZipFile, zlib.error) as error:
        raise ShardError(f"{path}: not a whole grasp entry ({error})") from error


def cache_grasps(
    scenes: Iterable[SceneLabels],
    network: SceneNetwork,
    folder: Path,
    *,
    n_views: int,
    seed: int,
    few_collisions: bool = False,
    workers: int = 1,
) -> int:
    """Look at labelled scenes from several sides and keep what is seen.

    Views that are in the folder already are not rendered again, so a killed run goes
    on where it was.

    Args:
        scenes: Labelled scenes.
        network: Gives the occupancy fields.
        folder: Where the entries go.
        n_views: Views per scene.
        seed: Seed of views and noise, together with the scene's number.
        few_collisions: See each scene ``with_few_collisions``, and no scene of which
            only collisions are known.
        workers: Processes; 1 stays in this one. What is seen does not depend on it.

    Returns:
        How many entries were added.
    """
    folder.mkdir(parents=True, exist_ok=True)
    todo = [
        labels
        for labels in scenes
        if len(labels.grasps)
        and not (few_collisions and _only_collisions(labels))
        and not all(_view_path(folder, labels, n).exists() for n in range(n_views))
    ]
    look = partial(
        _look_at, network=network, folder=folder, n_views=n_views, seed=seed,
        few_collisions=few_collisions,
    )  # fmt: skip
    if workers <= 1:
        return sum(_reported(map(look, todo), len(todo)))
    with process_pool(workers) as pool:
        done = pool.map(partial(_alone, look), todo, chunksize=8)
        return sum(_reported(done, len(todo)))


def _view_path(folder: Path, labels: SceneLabels, view: int) -> Path:
    return folder / f"{labels.index:07d}_{view}.npz"


def _alone(look: Callable[[SceneLabels], int], labels: SceneLabels) -> int:
    """Look with one thread: the other cores have processes of their own."""
    torch.set_num_threads(1)
    return look(labels)


def _look_at(
    labels: SceneLabels,
    *,
    network: SceneNetwork,
    folder: Path,
    n_views: int,
    seed: int,
    few_collisions: bool,
) -> int:
    """Keep the views of one scene that are missing; return how many were added."""
    added = 0
    for view in range(n_views):
        path = _view_path(folder, labels, view)
        if path.exists():
            continue
        rng = np.random.default_rng([seed, labels.index, view])
        camera = labels.T_task_camera if view == 0 else None
        shown = with_few_collisions(labels, rng) if few_collisions else labels
        entry = view_grasps(shown, network, rng, camera=camera)
        if entry is not None:
            save_grasps(entry, path)
            added += 1
    return added


def _only_collisions(labels: SceneLabels) -> bool:
    return not (labels.grasps.tried.any() or known_affordances(labels).any())


def with_few_collisions(labels: SceneLabels, rng: np.random.Generator) -> SceneLabels:
    """Leave out grasps that collide at once where a scene has many of them.

    They are cheap to label and quick to learn; grasps are drawn evenly from a scene,
    so what physics told of the others would be seen less often. Those that teach the
    affordances stay, and all of a scene without physics.

    Args:
        labels: A labelled scene; returned as it is if it has few of them.
        rng: Draws which ones stay.
    """
    grasps = labels.grasps
    if not grasps.tried.any():
        return labels
    collide = grasps.judged() & ~grasps.tried & ~known_affordances(labels)
    others = len(grasps) - int(collide.sum())
    most = max(LEAST_COLLISIONS, round(COLLISION_SHARE * others))
    if collide.sum() <= most:
        return labels
    kept = np.ones(len(grasps), dtype=bool)
    kept[rng.permutation(np.flatnonzero(collide))[most:]] = False
    return replace(labels, grasps=grasps.take(kept))


def _reported(counts: Iterable[int], n_scenes: int) -> Iterator[int]:
    """Pass counts on; log a line with a rate every quarter of a minute."""
    start = said = time.monotonic()
    for done, count in enumerate(counts, start=1):
        now = time.monotonic()
        if now - said > REPORT_SECONDS:
            said = now
            rate = done / (now - start)
            left = (n_scenes - done) / rate / 60
            LOGGER.info(
                "looked at the grasps of %d/%d scenes  %.2f scenes/s  %.0f min left",
                done, n_scenes, rate, left,
            )  # fmt: skip
        yield count
