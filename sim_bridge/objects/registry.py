# SPDX-License-Identifier: Apache-2.0
"""Find an object set by its name or folder, and split it by name."""

import importlib.util
import math
import os
import zlib
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

from neugrasp_ros.errors import ConfigError, ObjectFileError, UnknownNameError
from sim_bridge.objects import affordance, procedural
from sim_bridge.objects.meshes import find_meshes, load_bare_mesh, read_options
from sim_bridge.objects.model import ObjectModel
from sim_bridge.objects.partnet_set import find_partnet, load_partnet_shape
from sim_bridge.objects.urdf import find_urdfs, load_urdf

AFFORDANCE_LISTS = MappingProxyType(
    {
        affordance.SET_NAME: affordance.affordance_names,
        affordance.MIXED_SET_NAME: affordance.mixed_names,
    }
)
BUILT_IN = ("procedural", *AFFORDANCE_LISTS, "random_urdfs")
BROKEN_RANDOM_URDFS = ("168",)  # its vertices are not numbers, as published
FOLDERS_VARIABLE = "NEUGRASP_OBJECTS"  # folders that hold object folders, ':' between
N_CACHED = 2048  # models kept per set: about 0.1 MB each
SPLIT_MODULUS = 8
HELD_OUT = "held_out"
SPLIT_REMAINDERS = {"val": (0,), "tune": (1,), "train": tuple(range(2, SPLIT_MODULUS))}


class ObjectSet:
    """Named objects that are loaded when asked for.

    Args:
        name: Name of the set, as it appears in scene recipes.
        names: Names of its objects; they are sorted.
        loader: Makes the model of a name, which may be one beyond ``names`` in a set
            that is generated.
    """

    def __init__(
        self, name: str, names: Iterable[str], loader: Callable[[str], ObjectModel]
    ) -> None:
        self.name = name
        self.names = tuple(sorted(names))
        self._load = lru_cache(maxsize=N_CACHED)(loader)

    def load(self, name: str) -> ObjectModel:
        """Return the model of a name; the same object every time.

        Raises:
            UnknownNameError: If there is no such name.
            ObjectFileError: If its files are broken.
        """
        return self._load(name)

    def __len__(self) -> int:
        """Return the number of names."""
        return len(self.names)


@lru_cache(maxsize=32)
def object_set(name: str) -> ObjectSet:
    """Return an object set by name or by folder.

    Args:
        name: ``procedural``, ``affordance``, ``affordance_mixed`` (more of the same
            categories, of mixed parts, called ``affordance``, too), ``random_urdfs``;
            a folder of one-link
            URDFs, of bare OBJ/STL meshes, or of PartNet shapes; or the name of such a
            folder inside one of those that the environment variable
            ``NEUGRASP_OBJECTS`` lists. A folder's set is called like its last
            component. ``affordance/knife+scissors`` is the set ``affordance`` with
            the objects of these categories alone, and ``pile_train@0.8`` the set
            ``pile_train`` with those of at least 0.8 kg alone.

    Raises:
        UnknownNameError: If it is none of these.
        ObjectFileError: If a folder holds no object.
        ConfigError: If the mass is no positive number, or no object is so heavy.
    """
    whole, at, mass = name.rpartition("@")
    if at and not Path(name).is_dir():
        return _heavy_set(object_set(whole), mass)
    return _whole_set(name)


def _whole_set(name: str) -> ObjectSet:
    """Return a set by its name without a mass."""
    if name == procedural.SET_NAME:
        return ObjectSet(
            name, procedural.procedural_names(), procedural.load_procedural
        )
    set_name, _, categories = name.partition("/")
    if set_name in AFFORDANCE_LISTS:
        names = AFFORDANCE_LISTS[set_name]()
        return _affordance_set(names, categories.split("+") if categories else ())
    if name == "random_urdfs":
        return _folder_set(_random_urdfs_folder())
    for folder in (Path(name), *_search_folders(name)):
        if folder.is_dir() and (folder.is_absolute() or name not in BUILT_IN):
            return _folder_set(folder)
    raise UnknownNameError("object set", name, (*BUILT_IN, "or a folder"))


def split(names: Iterable[str], part: str) -> tuple[str, ...]:
    """Return the names of one part of a set, by a hash of the name alone.

    A name falls into the same part whatever the set, so an object that is in two sets
    is never trained on in one and tested in the other.

    Args:
        names: Object names.
        part: ``train``, ``tune`` (calibration and choices) or ``val``.

    Raises:
        UnknownNameError: If there is no such part.
    """
    if part not in SPLIT_REMAINDERS:
        raise UnknownNameError("split", part, SPLIT_REMAINDERS)
    wanted = SPLIT_REMAINDERS[part]
    return tuple(
        sorted(n for n in names if zlib.crc32(n.encode()) % SPLIT_MODULUS in wanted)
    )


def part_names(objects: ObjectSet, part: str) -> tuple[str, ...]:
    """Return the names of a part of an object set.

    Args:
        objects: The set.
        part: A part of ``split``, ``all``, or ``HELD_OUT``: the affordance objects of
            styles or seeds that are never learned from.

    Raises:
        ConfigError: If the part is empty, or of objects that are for training alone.
        UnknownNameError: If there is no such part.
    """
    if part == "all":
        return objects.names
    if part != "train" and _has_mixed(objects):
        raise ConfigError(
            f"{affordance.MIXED_SET_NAME!r} is for training alone, not for {part!r}"
        )
    if part == HELD_OUT:
        served = objects.name == affordance.SET_NAME
        names = _held_out_like(objects.names) if served else ()
    else:
        names = split(objects.names, part)
    if not names:
        raise ConfigError(f"the part {part!r} of {objects.name!r} is empty")
    return names


def _has_mixed(objects: ObjectSet) -> bool:
    named = objects.names if objects.name == affordance.SET_NAME else ()
    return any(affordance.parse_name(n).style == affordance.MIXED for n in named)


def _affordance_set(all_names: Iterable[str], categories: Iterable[str]) -> ObjectSet:
    """Return the affordance objects of a list, of some categories or of all."""
    wanted = set(categories) or set(affordance.STYLES)
    unknown = sorted(wanted - set(affordance.STYLES))
    if unknown:
        raise UnknownNameError("category", ", ".join(unknown), affordance.STYLES)
    names = [
        name for name in all_names if affordance.parse_name(name).category in wanted
    ]
    return ObjectSet(affordance.SET_NAME, names, affordance.load_affordance)


def _heavy_set(objects: ObjectSet, least: str) -> ObjectSet:
    """Return the objects of at least a mass in [kg]."""
    try:
        least_mass = float(least)
    except ValueError:
        least_mass = math.nan
    if not 0 < least_mass < math.inf:
        raise ConfigError(f"{least!r} is no mass in kg, as in pile_train@0.8")
    names = [name for name in objects.names if objects.load(name).mass >= least_mass]
    if not names:
        raise ConfigError(f"{objects.name!r} has no object of {least_mass} kg")
    return ObjectSet(objects.name, names, objects.load)


def _held_out_like(names: Iterable[str]) -> tuple[str, ...]:
    """Return the held-out objects of the categories that names are of."""
    served = {affordance.parse_name(name).category for name in names}
    held_out = affordance.held_out_names()
    return tuple(n for n in held_out if affordance.parse_name(n).category in served)


def _search_folders(name: str) -> list[Path]:
    roots = os.environ.get(FOLDERS_VARIABLE, "").split(os.pathsep)
    return [Path(root) / name for root in roots if root]


def _random_urdfs_folder() -> Path:
    spec = importlib.util.find_spec("pybullet_data")
    if spec is None or spec.origin is None:
        raise ObjectFileError("random_urdfs", "needs the package pybullet_data")
    return Path(spec.origin).parent / "random_urdfs"


def _folder_set(folder: Path) -> ObjectSet:
    set_name = folder.resolve().name
    urdfs = find_urdfs(folder)
    if set_name == "random_urdfs":
        urdfs = {k: v for k, v in urdfs.items() if k not in BROKEN_RANDOM_URDFS}
    if urdfs:
        return _path_set(set_name, urdfs, lambda path: load_urdf(path, set_name))
    shapes = find_partnet(folder)
    if shapes:
        return _path_set(
            set_name, shapes, lambda path: load_partnet_shape(path, set_name)
        )
    meshes = find_meshes(folder)
    if not meshes:
        raise ObjectFileError(folder, "holds no *.urdf, *.obj, *.stl or PartNet shapes")
    options = read_options(folder)
    return _path_set(
        set_name, meshes, lambda path: load_bare_mesh(path, set_name, options)
    )


def _path_set(
    set_name: str, paths: dict[str, Path], loader: Callable[[Path], ObjectModel]
) -> ObjectSet:
    def load(name: str) -> ObjectModel:
        if name not in paths:
            raise UnknownNameError(f"object of {set_name}", name, _nearest(name, paths))
        return loader(paths[name])

    return ObjectSet(set_name, paths, load)


def _nearest(name: str, names: Iterable[str], n_shown: int = 12) -> list[str]:
    """Return a few names, those that begin alike first."""

    def common(other: str) -> int:
        return len(os.path.commonprefix([name.lower(), other.lower()]))

    return sorted(sorted(names), key=common, reverse=True)[:n_shown]
