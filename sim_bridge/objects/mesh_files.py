# SPDX-License-Identifier: Apache-2.0
"""Read OBJ and STL files into plain meshes, fast and with clear errors."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ObjectFileError
from neugrasp_ros.geometry.mesh import Mesh
from sim_bridge.objects.mesh_repair import weld

MESH_SUFFIXES = (".obj", ".stl")
STL_HEADER = 84  # bytes before the first facet of a binary STL
STL_FACET = np.dtype([("n", "<3f4"), ("v", "<(3,3)f4"), ("attribute", "<u2")])


def read_mesh_groups(path: Path) -> tuple[Mesh, ...]:
    """Read a mesh file, one mesh per ``o`` group of an OBJ.

    Args:
        path: An OBJ or STL file.

    Returns:
        Meshes in the units of the file; one for a file without groups. Faces with more
        than three corners are cut into fans, empty groups are left out.

    Raises:
        ObjectFileError: If the file is missing, of another type, or broken.
    """
    if path.suffix.lower() not in MESH_SUFFIXES:
        raise ObjectFileError(path, f"expected one of {', '.join(MESH_SUFFIXES)}")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ObjectFileError(path, f"cannot be read: {error.strerror}") from error
    if path.suffix.lower() == ".stl":
        return (_parse_stl(path, content),)
    return _parse_obj(path, content.decode("utf-8", errors="replace"))


def _parse_obj(path: Path, text: str) -> tuple[Mesh, ...]:
    coordinates: list[list[str]] = []
    groups: list[list[tuple[int, ...]]] = [[]]
    try:
        for line in text.splitlines():
            words = line.split()
            if not words:
                continue
            if words[0] == "v":
                coordinates.append(words[1:4])
            elif words[0] == "f":
                corners = [int(word.split("/", 1)[0]) for word in words[1:]]
                n = len(coordinates)
                corners = [c - 1 if c > 0 else n + c for c in corners]
                groups[-1] += [
                    (corners[0], corners[i], corners[i + 1])
                    for i in range(1, len(corners) - 1)
                ]
            elif words[0] == "o":
                groups.append([])
        vertices = np.array(coordinates, dtype=np.float64).reshape(-1, 3)
    except ValueError as error:
        raise ObjectFileError(path, f"is not a valid OBJ: {error}") from error
    faces = [np.array(group) for group in groups if group]
    if not faces:
        raise ObjectFileError(path, "has no faces")
    return tuple(_checked(path, vertices, group) for group in faces)


def _checked(
    path: Path, vertices: NDArray[np.float64], triangles: NDArray[np.int_]
) -> Mesh:
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise ObjectFileError(
            path, f"a face names a vertex beyond the {len(vertices)} there are"
        )
    used, inverse = np.unique(triangles, return_inverse=True)
    if not np.isfinite(vertices[used]).all():
        raise ObjectFileError(path, "has a vertex that is not finite")
    return Mesh(vertices[used], inverse.reshape(-1, 3).astype(np.int32))


def _parse_stl(path: Path, content: bytes) -> Mesh:
    n_facets = 0
    if len(content) >= STL_HEADER:
        n_facets = int(np.frombuffer(content, "<u4", count=1, offset=80)[0])
    if n_facets and len(content) == STL_HEADER + n_facets * STL_FACET.itemsize:
        facets = np.frombuffer(content, STL_FACET, offset=STL_HEADER)
        corners = facets["v"].astype(np.float64)
    elif content.lstrip().startswith(b"solid"):
        corners = _parse_ascii_stl(path, content.decode("utf-8", errors="replace"))
    else:
        raise ObjectFileError(
            path, f"is not a valid STL: {len(content)} bytes for {n_facets} facets"
        )
    if len(corners) == 0 or not np.isfinite(corners).all():
        raise ObjectFileError(path, "has no facets, or a vertex that is not finite")
    return weld(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3))


def _parse_ascii_stl(path: Path, text: str) -> NDArray[np.float64]:
    words = [line.split()[1:4] for line in text.splitlines() if "vertex" in line]
    try:
        return np.array(words, dtype=np.float64).reshape(-1, 3, 3)
    except ValueError as error:
        raise ObjectFileError(path, f"is not a valid ASCII STL: {error}") from error
