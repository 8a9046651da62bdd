# SPDX-License-Identifier: Apache-2.0
"""Scenes as recipes: which objects lie where. No physics in here."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, ShapeError, UnknownNameError
from neugrasp_ros.geometry.mesh import Mesh
from sim_bridge.objects.meshes import EGAD_FRICTION, EGAD_MASS
from sim_bridge.objects.model import ObjectModel, Part
from sim_bridge.objects.registry import ObjectSet, object_set
from sim_bridge.objects.tessellation import hull_mesh

FloatArray = NDArray[np.float64]

SCENE_KINDS = ("pile", "packed", "egad", "empty")


@dataclass(frozen=True, eq=False, slots=True)
class PlacedObject:
    """One object of a scene.

    Attributes:
        set_name: Name of its object set.
        name: Its name within the set.
        scale: Factor on its lengths [-].
        T_task_object: Pose of its frame, shape (4, 4).
    """

    set_name: str
    name: str
    scale: float
    T_task_object: FloatArray

    def __post_init__(self) -> None:
        """Check the pose and make it a read-only copy.

        Raises:
            ShapeError: If the pose is not (4, 4).
        """
        pose = np.array(self.T_task_object, dtype=np.float64)
        if pose.shape != (4, 4):
            raise ShapeError("T_task_object", "(4, 4)", pose.shape)
        pose.setflags(write=False)
        object.__setattr__(self, "T_task_object", pose)

    def at(self, T_task_object: FloatArray) -> "PlacedObject":
        """Return the same object at another pose."""
        return replace(self, T_task_object=T_task_object)


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A recipe from which a scene can be built again, to see it or to touch it.

    Attributes:
        kind: One of ``SCENE_KINDS``.
        seed: The seed it was drawn with; -1 if there was none.
        objects: What lies on the table, at rest.
    """

    kind: str
    seed: int
    objects: tuple[PlacedObject, ...]

    def __post_init__(self) -> None:
        """Check the kind.

        Raises:
            UnknownNameError: If the kind is none of ``SCENE_KINDS``.
        """
        if self.kind not in SCENE_KINDS:
            raise UnknownNameError("scene kind", self.kind, SCENE_KINDS)

    def as_record(self) -> dict[str, Any]:
        """Return the scene as plain values for JSON; ``scene_from_record`` reads it."""
        return {
            "kind": self.kind,
            "seed": self.seed,
            "objects": [
                {
                    "set": placed.set_name,
                    "name": placed.name,
                    "scale": placed.scale,
                    "T_task_object": placed.T_task_object[:3].ravel().tolist(),
                }
                for placed in self.objects
            ],
        }


def scene_from_record(record: Mapping[str, Any]) -> Scene:
    """Read a scene from the values that ``Scene.as_record`` wrote.

    Raises:
        ConfigError: If a value is missing or a pose has not twelve numbers.
    """
    try:
        objects = tuple(
            PlacedObject(
                item["set"],
                item["name"],
                float(item["scale"]),
                np.vstack([np.reshape(item["T_task_object"], (3, 4)), [0, 0, 0, 1]]),
            )
            for item in record["objects"]
        )
        return Scene(record["kind"], int(record["seed"]), objects)
    except (KeyError, ValueError) as error:
        raise ConfigError(f"not a scene record: {error}") from error


class SceneMeshes(NamedTuple):
    """What ``MeshScene`` takes.

    Attributes:
        meshes: Closed meshes, each in its object's frame.
        poses: Their poses ``T_task_mesh``, shape (M, 4, 4).
        body_ids: Index of the object in the scene, for each mesh.
    """

    meshes: tuple[Mesh, ...]
    poses: FloatArray
    body_ids: tuple[int, ...]


def placed_model(
    placed: PlacedObject, sets: Mapping[str, ObjectSet] | None = None
) -> ObjectModel:
    """Load the model of a placed object at its scale.

    Args:
        placed: The placed object.
        sets: Object sets by name; those not in it are looked up in the registry.
    """
    known = (sets or {}).get(placed.set_name)
    source = object_set(placed.set_name) if known is None else known
    return source.load(placed.name).scaled(placed.scale)


def scene_meshes(
    scene: Scene, sets: Mapping[str, ObjectSet] | None = None
) -> SceneMeshes:
    """Return the true shapes of a scene's objects where the recipe puts them.

    Args:
        scene: The scene.
        sets: Object sets by name; those not in it are looked up in the registry.
    """
    models = [placed_model(placed, sets) for placed in scene.objects]
    return posed_meshes(models, [placed.T_task_object for placed in scene.objects])


def posed_meshes(models: list[ObjectModel], poses: list[FloatArray]) -> SceneMeshes:
    """Return the true shapes of models at poses (B of 4x4); ids count the models."""
    meshes = tuple(mesh for model in models for mesh in model.visuals)
    owners = tuple(i for i, model in enumerate(models) for _ in model.visuals)
    stacked = np.array([poses[i] for i in owners]).reshape(-1, 4, 4)
    return SceneMeshes(meshes, stacked, owners)


def physical_model(kind: str, model: ObjectModel) -> ObjectModel:
    """Return what collides in a scene of a kind.

    In ``egad`` scenes that is the convex hull of the mesh with the benchmark's mass
    and friction; elsewhere the model as it is.
    """
    if kind != "egad":
        return model
    vertices = np.concatenate([mesh.vertices for mesh in model.visuals])
    hull = Part("hull", vertices=hull_mesh(vertices).vertices)
    return replace(model, parts=(hull,), mass=EGAD_MASS, friction=EGAD_FRICTION)
