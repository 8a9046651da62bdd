# SPDX-License-Identifier: Apache-2.0
"""Load objects described by one-link URDF files."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp_ros.errors import ConfigError, ObjectFileError
from neugrasp_ros.geometry.mesh import Mesh
from neugrasp_ros.geometry.transform import make_transform
from sim_bridge.objects.mesh_files import read_mesh_groups
from sim_bridge.objects.mesh_repair import close_meshes, is_watertight
from sim_bridge.objects.model import ObjectModel, Part, part_mesh

FloatArray = NDArray[np.float64]

DEFAULT_FRICTION = 1.0  # what the object files of the field carry [-]
DEFAULT_MASS = 0.1  # for a URDF without an inertial element [kg]


def find_urdfs(folder: Path) -> dict[str, Path]:
    """Return the URDF files in a folder or one level below it, by stem, sorted."""
    paths = [*folder.glob("*.urdf"), *folder.glob("*/*.urdf")]
    return {path.stem: path for path in sorted(paths, key=lambda path: path.stem)}


def load_urdf(path: Path, set_name: str) -> ObjectModel:
    """Load a one-link URDF: shape, mass, friction and centre of mass.

    Every ``o`` group of a collision OBJ becomes one convex hull. The visual shape is
    taken as it is if it is closed; if not, the collision parts stand in for it and the
    model's note says so.

    Args:
        path: The URDF file; mesh names in it are relative to its folder.
        set_name: Name of the set that the object belongs to.

    Raises:
        ObjectFileError: If a file is missing or broken, or there is more than one link.
    """
    link = _read_link(path)
    parts = tuple(p for item in link.findall("collision") for p in _parts(path, item))
    if not parts:
        raise ObjectFileError(path, "has no collision geometry")
    visuals, note = _visuals(path, link, parts)
    mass = _number(path, link.find("inertial/mass"), DEFAULT_MASS)
    friction = _number(path, link.find("contact/lateral_friction"), DEFAULT_FRICTION)
    try:
        return ObjectModel(
            name=path.stem,
            set_name=set_name,
            parts=parts,
            visuals=visuals,
            mass=mass,
            friction=friction,
            center_of_mass=_origin(path, link.find("inertial"))[:3, 3],
            note=note,
        )
    except ConfigError as error:
        raise ObjectFileError(path, str(error)) from error


def _read_link(path: Path) -> ElementTree.Element:
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise ObjectFileError(path, f"cannot be read: {error.strerror}") from error
    except ElementTree.ParseError as error:
        raise ObjectFileError(path, f"is not valid XML: {error}") from error
    links = root.findall("link")
    if len(links) != 1:
        raise ObjectFileError(path, f"expected one link, found {len(links)}")
    return links[0]


def _floats(path: Path, text: str, n: int) -> FloatArray:
    try:
        values = np.array(text.split(), dtype=np.float64)
    except ValueError as error:
        raise ObjectFileError(path, f"expected {n} numbers, got {text!r}") from error
    if values.shape != (n,) or not np.isfinite(values).all():
        raise ObjectFileError(path, f"expected {n} numbers, got {text!r}")
    return values


def _number(path: Path, element: ElementTree.Element | None, default: float) -> float:
    if element is None:
        return default
    return float(_floats(path, element.get("value", ""), 1)[0])


def _origin(path: Path, element: ElementTree.Element | None) -> FloatArray:
    origin = None if element is None else element.find("origin")
    if origin is None:
        return np.eye(4)
    rpy = _floats(path, origin.get("rpy", "0 0 0"), 3)
    xyz = _floats(path, origin.get("xyz", "0 0 0"), 3)
    return make_transform(Rotation.from_euler("xyz", rpy).as_matrix(), xyz)


def _mesh_groups(path: Path, mesh: ElementTree.Element) -> list[Mesh]:
    name = mesh.get("filename", "")
    if "://" in name:
        raise ObjectFileError(path, f"expected a mesh beside the URDF, got {name!r}")
    scale = _floats(path, mesh.get("scale", "1 1 1"), 3)
    groups = read_mesh_groups(path.parent / name)
    return [Mesh(group.vertices * scale, group.triangles) for group in groups]


def _primitive(path: Path, shape: ElementTree.Element, pose: FloatArray) -> Part:
    if shape.tag == "box":
        half = tuple(_floats(path, shape.get("size", ""), 3) / 2)
        return Part("box", half, pose)
    if shape.tag not in ("cylinder", "sphere"):
        raise ObjectFileError(path, f"unknown geometry {shape.tag!r}")
    size = [_floats(path, shape.get("radius", ""), 1)[0]]
    if shape.tag == "cylinder":
        size.append(_floats(path, shape.get("length", ""), 1)[0])
    return Part(shape.tag, tuple(size), pose)


def _shape(path: Path, item: ElementTree.Element) -> ElementTree.Element:
    geometry = item.find("geometry")
    if geometry is None or len(geometry) != 1:
        raise ObjectFileError(path, f"a {item.tag} needs exactly one geometry")
    return geometry[0]


def _parts(path: Path, item: ElementTree.Element) -> list[Part]:
    pose, shape = _origin(path, item), _shape(path, item)
    if shape.tag != "mesh":
        return [_primitive(path, shape, pose)]
    groups = _mesh_groups(path, shape)
    return [Part("hull", (), pose, vertices=group.vertices) for group in groups]


def _visuals(
    path: Path, link: ElementTree.Element, parts: tuple[Part, ...]
) -> tuple[tuple[Mesh, ...], str]:
    meshes: list[Mesh] = []
    notes: list[str] = []
    for item in link.findall("visual"):
        pose, shape = _origin(path, item), _shape(path, item)
        if shape.tag != "mesh":
            meshes.append(part_mesh(_primitive(path, shape, pose)))
            continue
        closed, note = close_meshes(_mesh_groups(path, shape))
        meshes += [mesh.transformed(pose) for mesh in closed]
        notes += [f"visual mesh: {note}"] if note else []
    if not meshes or not all(is_watertight(mesh) for mesh in meshes):
        notes.append("the collision parts stand in for the visual mesh")
        meshes = [part_mesh(part) for part in parts]
    return tuple(meshes), "; ".join(notes)
