# SPDX-License-Identifier: Apache-2.0
"""Load objects that are nothing but an OBJ or STL file: unit, mass, convex parts."""

import hashlib
import importlib
import importlib.util
import logging
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, ObjectFileError
from neugrasp_ros.geometry.mesh import Mesh
from sim_bridge.objects.mesh_files import MESH_SUFFIXES, read_mesh_groups
from sim_bridge.objects.mesh_repair import close_meshes, is_watertight, merge_meshes
from sim_bridge.objects.model import ObjectModel, Part, mesh_centroid, part_mesh
from sim_bridge.objects.tessellation import hull_mesh

LOG = logging.getLogger(__name__)
FloatArray = NDArray[np.float64]

LARGEST_METRIC = 2.0  # a bare mesh longer than this is not in metres but millimetres
MILLIMETRE = 0.001
DENSITY = 400.0  # of a household thing with its hollows [kg/m^3]
MASS_RANGE = (0.03, 1.0)  # bounds of a mass guessed from the volume [kg]
CONVEX_FILL = 0.97  # a mesh that fills this much of its hull counts as convex [-]
DECOMPOSITION = {  # of coacd: some seconds and at most two dozen parts a mesh
    "threshold": 0.08,
    "max_convex_hull": 24,
    "resolution": 1000,
    "mcts_iterations": 40,
    "mcts_nodes": 10,
    "mcts_max_depth": 2,
}
SIDECAR = "objects.yaml"
EGAD_MASS = 0.15  # [kg]
EGAD_FRICTION = 0.75


@dataclass(frozen=True)
class MeshFolderOptions:
    """What a folder of bare meshes may say in its ``objects.yaml``.

    Attributes:
        unit: Metres per file unit; 0 guesses: 0.001 if an edge is longer than 2.
        mass: Of every object in [kg]; 0 guesses from the volume.
        friction: Lateral friction coefficient [-].
        decompose: Whether concave meshes are cut into convex parts; else their hull.
    """

    unit: float = 0.0
    mass: float = 0.0
    friction: float = 1.0
    decompose: bool = True


def find_meshes(folder: Path) -> dict[str, Path]:
    """Return the mesh files of a folder by stem, sorted."""
    paths = [path for path in folder.iterdir() if path.suffix.lower() in MESH_SUFFIXES]
    return {path.stem: path for path in sorted(paths, key=lambda path: path.stem)}


def read_options(folder: Path) -> MeshFolderOptions:
    """Read the folder's ``objects.yaml``; defaults if there is none.

    Raises:
        ConfigError: If the file has unknown keys or is no mapping.
    """
    path = folder / SIDECAR
    if not path.exists():
        return MeshFolderOptions()
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        return MeshFolderOptions(**values)
    except (TypeError, yaml.YAMLError) as error:
        known = ", ".join(MeshFolderOptions.__dataclass_fields__)
        raise ConfigError(f"{path}: expected a mapping of {known}: {error}") from error


def load_bare_mesh(
    path: Path, set_name: str, options: MeshFolderOptions
) -> ObjectModel:
    """Load a mesh file as an object centred on its bounding box.

    A mesh that is not closed is welded and its holes are filled; if that fails, its
    convex parts stand in for it. The model's note says what was done.

    Args:
        path: An OBJ or STL file.
        set_name: Name of the set that the object belongs to.
        options: Unit, mass, friction and whether to decompose.

    Raises:
        ObjectFileError: If the file is broken or encloses no volume.
    """
    groups = read_mesh_groups(path)
    whole = merge_meshes(groups)
    extent = float(np.ptp(whole.bounds(), axis=0).max())
    unit = options.unit or (MILLIMETRE if extent > LARGEST_METRIC else 1.0)
    center = whole.bounds().mean(axis=0)
    groups = tuple(Mesh((g.vertices - center) * unit, g.triangles) for g in groups)
    visuals, note = close_meshes(groups)
    notes = [note] if note else []
    try:
        parts, note = _convex_parts(visuals, options.decompose)
    except ObjectFileError as error:
        raise ObjectFileError(path, f"encloses no volume ({error})") from error
    if not all(is_watertight(mesh) for mesh in visuals):
        visuals = tuple(part_mesh(part) for part in parts)
        notes.append("the convex parts stand in for the mesh")
    notes += [note] if note else []
    if notes:
        LOG.warning("%s: %s", path.name, "; ".join(notes))
    volume = sum(mesh.volume() for mesh in visuals)
    return ObjectModel(
        name=path.stem,
        set_name=set_name,
        parts=parts,
        visuals=visuals,
        mass=options.mass or float(np.clip(volume * DENSITY, *MASS_RANGE)),
        friction=options.friction,
        center_of_mass=mesh_centroid(merge_meshes(visuals)),
        note="; ".join(notes),
        file_unit=unit,
    )


def egad_scale(model: ObjectModel, draw: float) -> float:
    """Return the scale that the EGAD protocol gives to an object.

    The published loop shrinks the raw file until its edges suit a pile.

    Args:
        model: An object loaded from a bare mesh.
        draw: The scale drawn for this placement, U(0.8, 1.4) [-].

    Returns:
        Factor for :meth:`ObjectModel.scaled`, relative to the loaded model.
    """
    raw = model.extents() / model.file_unit
    factor = draw
    while True:
        edges = np.sort(raw * factor)
        if edges[1] > 0.15 * draw:
            factor *= 0.8
        elif edges.prod() > 0.0006 * draw**3:
            factor *= 0.85
        elif edges[0] < 0.014 * draw:
            factor /= 0.95
            if (np.sort(raw * factor)[1] > 0.15 * draw) or (
                (raw * factor).prod() > 0.0006 * draw**3
            ):
                break  # a flat thing would shrink and grow for ever
        else:
            break
    return float(factor / model.file_unit)


def _convex_parts(
    meshes: tuple[Mesh, ...], decompose: bool
) -> tuple[tuple[Part, ...], str]:
    hulls = [hull_mesh(mesh.vertices) for mesh in meshes]
    fills = [m.volume() / h.volume() for m, h in zip(meshes, hulls, strict=True)]
    if min(fills) >= CONVEX_FILL:
        return tuple(_hull_part(hull.vertices) for hull in hulls), ""
    whole = merge_meshes(meshes)
    if decompose and importlib.util.find_spec("coacd") is not None:
        return tuple(_hull_part(v) for v in _decomposition(whole)), ""
    note = f"collides as its convex hull, which it fills to {100 * min(fills):.0f} %"
    reason = "install coacd for convex parts" if decompose else "decompose is off"
    return (_hull_part(hull_mesh(whole.vertices).vertices),), f"{note} ({reason})"


def _hull_part(vertices: FloatArray) -> Part:
    return Part("hull", (), vertices=vertices)


def _decomposition(mesh: Mesh) -> list[FloatArray]:
    """Cut a mesh into convex pieces; kept on disk, since it takes seconds."""
    digest = hashlib.sha256(mesh.vertices.tobytes() + mesh.triangles.tobytes())
    root = Path(os.environ.get("XDG_CACHE_HOME", "~/.cache")).expanduser()
    cached = root / "neugrasp_ros" / "convex" / f"{digest.hexdigest()[:32]}.npz"
    if cached.exists():
        with np.load(cached) as pieces:
            return [pieces[name] for name in sorted(pieces.files)]
    coacd = importlib.import_module("coacd")
    coacd.set_log_level("error")
    solid = coacd.Mesh(np.array(mesh.vertices), np.array(mesh.triangles))
    result = coacd.run_coacd(solid, **DECOMPOSITION)
    pieces = [np.asarray(vertices, dtype=np.float64) for vertices, _ in result]
    cached.parent.mkdir(parents=True, exist_ok=True)
    partial = cached.with_suffix(f".{os.getpid()}.npz")
    np.savez(partial, **{f"{index:04d}": piece for index, piece in enumerate(pieces)})
    partial.replace(cached)
    return pieces
