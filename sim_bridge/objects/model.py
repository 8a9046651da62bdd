# SPDX-License-Identifier: Apache-2.0
"""What an object is: convex parts for the physics, closed meshes for the eye."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError
from neugrasp_ros.geometry.mesh import Mesh
from sim_bridge.objects.tessellation import hull_mesh, primitive_mesh, primitive_volume

FloatArray = NDArray[np.float64]

SIZE_LENGTHS = {"box": 3, "cylinder": 2, "sphere": 1, "capsule": 2, "hull": 0}


def _frozen(array: FloatArray) -> FloatArray:
    copy = np.array(array, dtype=np.float64)
    copy.setflags(write=False)
    return copy


@dataclass(frozen=True, eq=False, slots=True)
class Part:
    """One convex piece of an object.

    Attributes:
        kind: ``box``, ``cylinder``, ``sphere``, ``capsule`` or ``hull``.
        size: In [m]: half extents of a box (3); radius and length along z of a
            cylinder; radius of a sphere; radius and length without the caps of a
            capsule; empty for a hull.
        pose: ``T_object_part``, shape (4, 4).
        label: What the part is called, such as ``handle``; empty if it has no name.
        vertices: Points in the part's frame whose convex hull it is, shape (V, 3);
            None for the other kinds.
    """

    kind: str
    size: tuple[float, ...] = ()
    pose: FloatArray = field(default_factory=lambda: np.eye(4))
    label: str = ""
    vertices: FloatArray | None = None

    def __post_init__(self) -> None:
        """Check kind and size; make the arrays read-only copies.

        Raises:
            ConfigError: If the size does not fit the kind or is not positive.
        """
        expected = SIZE_LENGTHS.get(self.kind)
        if expected is None:
            raise ConfigError(
                f"part kind {self.kind!r}; known: {', '.join(SIZE_LENGTHS)}"
            )
        if len(self.size) != expected or any(value <= 0 for value in self.size):
            raise ConfigError(
                f"a {self.kind} needs {expected} positive sizes, got {self.size}"
            )
        if (self.kind == "hull") != (self.vertices is not None):
            raise ConfigError("a hull has vertices, the other kinds have none")
        object.__setattr__(self, "size", tuple(float(value) for value in self.size))
        object.__setattr__(self, "pose", _frozen(self.pose))
        if self.vertices is not None:
            object.__setattr__(self, "vertices", _frozen(self.vertices))

    def scaled(self, factor: float) -> "Part":
        """Return the part with sizes and position multiplied by ``factor``."""
        pose = self.pose.copy()
        pose[:3, 3] *= factor
        vertices = None if self.vertices is None else self.vertices * factor
        size = tuple(value * factor for value in self.size)
        return replace(self, size=size, pose=pose, vertices=vertices)


def part_local_mesh(part: Part) -> Mesh:
    """Tessellate a part in its own frame, closed and outward."""
    if part.vertices is not None:
        return hull_mesh(part.vertices)
    return primitive_mesh(part.kind, part.size)


def part_mesh(part: Part) -> Mesh:
    """Tessellate a part in the object's frame, closed and outward."""
    return part_local_mesh(part).transformed(part.pose)


def part_volume(part: Part) -> float:
    """Return the volume of a part in [m^3], exact for every kind."""
    if part.vertices is not None:
        return hull_mesh(part.vertices).volume()
    return primitive_volume(part.kind, part.size)


class PointLabels(NamedTuple):
    """Points of a surface with what holding them affords.

    Attributes:
        points: In the object's frame in [m], shape (N, 3).
        classes: One column per affordance class, shape (N, 7).
    """

    points: FloatArray
    classes: NDArray[np.bool_]


@dataclass(frozen=True, eq=False, slots=True)
class ObjectModel:
    """An object in its own frame: z up, origin near the centre of its bounds.

    Attributes:
        name: Name within its set.
        set_name: Name of the set.
        parts: Convex collision parts.
        visuals: Closed meshes whose union is the true shape.
        mass: In [kg].
        friction: Lateral friction coefficient [-].
        category: What it is, such as ``mug``; empty if unknown.
        style: Which kind of that; empty if unknown.
        center_of_mass: In the object's frame in [m], shape (3,).
        note: What about the model is approximate, in words; empty if nothing is.
        file_unit: Metres per unit of the file it came from [m].
        point_labels: Affordances of its surface, if they came with it and do not
            follow from its parts.
    """

    name: str
    set_name: str
    parts: tuple[Part, ...]
    visuals: tuple[Mesh, ...]
    mass: float
    friction: float = 1.0
    category: str = ""
    style: str = ""
    center_of_mass: FloatArray = field(default_factory=lambda: np.zeros(3))
    note: str = ""
    file_unit: float = 1.0
    point_labels: PointLabels | None = None

    def __post_init__(self) -> None:
        """Check the mass and make the arrays read-only.

        Raises:
            ConfigError: If there is no part, or the mass is not positive.
        """
        if not self.parts or not self.visuals:
            raise ConfigError(f"object {self.name!r} has no parts")
        if not self.mass > 0:
            raise ConfigError(f"object {self.name!r}: mass {self.mass} is not positive")
        object.__setattr__(self, "center_of_mass", _frozen(self.center_of_mass))

    def scaled(self, factor: float) -> "ObjectModel":
        """Return the object with all lengths multiplied by ``factor``.

        The mass stays, as it does when a physics engine scales a URDF.
        """
        if factor == 1.0:
            return self
        labels = self.point_labels
        if labels is not None:
            labels = PointLabels(labels.points * factor, labels.classes)
        return replace(
            self,
            point_labels=labels,
            parts=tuple(part.scaled(factor) for part in self.parts),
            visuals=tuple(mesh.scaled(factor) for mesh in self.visuals),
            center_of_mass=self.center_of_mass * factor,
        )

    def bounds(self) -> FloatArray:
        """Return the lower and upper corner of the true shape in [m], shape (2, 3)."""
        corners = np.stack([mesh.bounds() for mesh in self.visuals])  # (M, 2, 3)
        return np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])

    def extents(self) -> FloatArray:
        """Return the edges of the bounding box in [m], shape (3,)."""
        lower, upper = self.bounds()
        return np.asarray(upper - lower)

    def part_labels(self) -> tuple[str, ...]:
        """Return the label of each part."""
        return tuple(part.label for part in self.parts)


def compound_mass(
    parts: Sequence[Part], meshes: Sequence[Mesh], density: float
) -> tuple[float, FloatArray]:
    """Return mass in [kg] and centre of mass (3,) in [m] of parts of one density.

    Overlaps of parts count twice.

    Args:
        parts: The parts of an object.
        meshes: Their meshes in the object's frame.
        density: In [kg/m^3]; for hollow things that of the enclosed volume.
    """
    is_hull = [part.kind == "hull" for part in parts]
    pairs = list(zip(parts, meshes, is_hull, strict=True))
    volumes = [
        m.volume() if h else primitive_volume(p.kind, p.size) for p, m, h in pairs
    ]
    centers = [mesh_centroid(m) if h else p.pose[:3, 3] for p, m, h in pairs]
    center = np.average(np.stack(centers), axis=0, weights=volumes)
    return density * float(np.sum(volumes)), np.asarray(center)


def mesh_centroid(mesh: Mesh) -> FloatArray:
    """Return the centre of the volume that a closed mesh encloses, shape (3,)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, i]] for i in range(3))
    volumes = np.einsum("ij,ij->i", a, np.cross(b, c))
    if abs(volumes.sum()) < 1e-15:
        return np.asarray(mesh.bounds().mean(axis=0))
    return np.asarray(np.average((a + b + c) / 4.0, axis=0, weights=volumes))
