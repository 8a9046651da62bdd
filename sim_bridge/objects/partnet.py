# SPDX-License-Identifier: Apache-2.0
"""Load shapes laid out like PartNet's: a folder of part meshes and a tree of labels."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp_ros.errors import ObjectFileError
from neugrasp_ros.geometry.mesh import Mesh
from sim_bridge.objects.affordances import PART_TABLE
from sim_bridge.objects.mesh_files import read_mesh_groups
from sim_bridge.objects.mesh_repair import close_meshes, is_watertight, merge_meshes
from sim_bridge.objects.model import ObjectModel, Part, compound_mass, part_mesh
from sim_bridge.objects.tessellation import hull_mesh

TREE = "result_after_merging.json"
MESH_FOLDER = "objs"
DENSITY = 400.0  # [kg/m^3]
Y_UP_TO_Z_UP = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])

# Words in PartNet's part names and the labels that docs/affordances.md knows, the
# first match counts.
PART_WORDS = (
    ("strap", "strap"), ("handle", "handle"), ("blade", "blade"), ("neck", "neck"),
    ("lid", "neck"), ("mouth", "neck"), ("closure", "neck"), ("opening", "opening"),
    ("rim", "rim"), ("headband", "headband"), ("head_band", "headband"),
    ("earcup", "cup"), ("earphone_unit", "cup"), ("earbud", "plug"), ("wire", "cable"),
    ("connector", "cable"), ("brim", "brim"), ("bill", "brim"), ("crown", "crown"),
    ("panel", "crown"), ("body", "body"), ("container", "body"),
)  # fmt: skip


@dataclass(frozen=True)
class PartNetOptions:
    """How a shape without a unit becomes a thing.

    Attributes:
        category: One of ours, such as ``mug``.
        size: Longest edge of the object in [m].
        density: In [kg/m^3].
    """

    category: str
    size: float
    density: float = DENSITY


def load_partnet(folder: Path, options: PartNetOptions) -> ObjectModel:
    """Load one shape: every part mesh becomes a labelled convex part.

    PartNet's meshes are seldom closed; a part that is not is replaced by its hull, and
    the model's note counts them. Their y axis is up; ours is z.

    Args:
        folder: Holds ``result_after_merging.json`` and ``objs/*.obj``.
        options: Category, size and density.

    Raises:
        ObjectFileError: If a file is missing or broken, or a name leads to no label.
    """
    tree = _read_tree(folder / TREE)
    parts: list[Part] = []
    visuals: list[Mesh] = []
    n_replaced = 0
    for name, files in _leaves(tree):
        label = part_label(folder, name, options.category)
        for file in files:
            groups = read_mesh_groups(folder / MESH_FOLDER / f"{file}.obj")
            whole = merge_meshes(close_meshes(groups)[0])
            turned = Mesh(whole.vertices @ Y_UP_TO_Z_UP.T, whole.triangles)
            hull = hull_mesh(turned.vertices)
            parts.append(Part("hull", (), np.eye(4), label, hull.vertices))
            n_replaced += not is_watertight(turned)
            visuals.append(turned if is_watertight(turned) else hull)
    if not parts:
        raise ObjectFileError(folder / TREE, "names no part mesh")
    return _placed(folder.name, parts, visuals, options, n_replaced)


def part_label(folder: Path, name: str, category: str) -> str:
    """Return our label for a PartNet part name.

    Raises:
        ObjectFileError: If no word of the name leads to a label of the category.
    """
    known = PART_TABLE.get(category, {})
    for word, label in PART_WORDS:
        if word in name.lower() and label in known:
            return label
    expected = ", ".join(known) or "nothing"
    raise ObjectFileError(
        folder, f"part {name!r} has no label; a {category} knows {expected}"
    )


def _read_tree(path: Path) -> list[Any]:
    try:
        tree = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ObjectFileError(path, f"cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ObjectFileError(path, f"is not valid JSON: {error}") from error
    if not isinstance(tree, list):
        raise ObjectFileError(path, "expected a list of parts")
    return tree


def _leaves(nodes: list[Any], above: str = "") -> Iterator[tuple[str, list[str]]]:
    """Yield name, after the names of its parents, and mesh files of every leaf."""
    for node in nodes:
        name = f"{node.get('name', '')}/{above}"
        if node.get("children"):
            yield from _leaves(node["children"], name)
        else:
            yield name, list(node.get("objs", []))


def _placed(
    name: str, parts: list[Part], visuals: list[Mesh], options: PartNetOptions,
    n_replaced: int,
) -> ObjectModel:  # fmt: skip
    corners = np.concatenate([mesh.bounds() for mesh in visuals])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    factor = options.size / float((upper - lower).max())
    shift = np.eye(4)
    shift[:3, 3] = -(lower + upper) / 2
    placed = tuple(
        Part("hull", (), shift, part.label, part.vertices).scaled(factor)
        for part in parts
    )
    meshes = tuple(mesh.transformed(shift).scaled(factor) for mesh in visuals)
    hulls = [part_mesh(part) for part in placed]
    mass, center = compound_mass(placed, hulls, options.density)
    return ObjectModel(
        name=name,
        set_name="partnet",
        parts=placed,
        visuals=meshes,
        mass=mass,
        category=options.category,
        center_of_mass=center,
        note=f"{n_replaced} open part meshes replaced by hulls" if n_replaced else "",
    )
