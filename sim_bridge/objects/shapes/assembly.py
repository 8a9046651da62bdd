# SPDX-License-Identifier: Apache-2.0
"""Turn the parts of a shape into an object: centred, with mass and visuals."""

import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim_bridge.objects.model import (
    ObjectModel,
    Part,
    compound_mass,
    part_mesh,
)

MASS_RANGE = (0.03, 0.8)  # what a small arm lifts with a friction grasp [kg]


class Shape(NamedTuple):
    """What a generator makes.

    Attributes:
        parts: Convex parts, z up, standing as the thing stands on a table.
        density: In [kg/m^3]; of a hollow body that of the volume it encloses.
    """

    parts: Sequence[Part]
    density: float


def seeded(name: str) -> np.random.Generator:
    """Return the generator that belongs to a name, the same on every machine."""
    return np.random.default_rng(zlib.crc32(name.encode()))


def assemble(
    shape: Shape, name: str, set_name: str, category: str = "", style: str = ""
) -> ObjectModel:
    """Make an object of a shape, its origin at the centre of its bounds.

    Args:
        shape: Parts and density.
        name: Name of the object.
        set_name: Name of its set.
        category: What it is.
        style: Which kind of that.
    """
    meshes = [part_mesh(part) for part in shape.parts]
    lower = np.min([mesh.bounds()[0] for mesh in meshes], axis=0)
    upper = np.max([mesh.bounds()[1] for mesh in meshes], axis=0)
    shift = np.eye(4)
    shift[:3, 3] = -(lower + upper) / 2
    parts = tuple(replace(part, pose=shift @ part.pose) for part in shape.parts)
    visuals = tuple(mesh.transformed(shift) for mesh in meshes)
    mass, center = compound_mass(parts, visuals, shape.density)
    return ObjectModel(
        name=name,
        set_name=set_name,
        parts=parts,
        visuals=visuals,
        mass=float(np.clip(mass, *MASS_RANGE)),
        category=category,
        style=style,
        center_of_mass=center,
    )
