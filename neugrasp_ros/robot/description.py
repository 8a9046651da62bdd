# SPDX-License-Identifier: Apache-2.0
"""Which robot this is: a URDF somewhere else, and a YAML file that says how to read it.

The URDF is never copied: it is read where it lies, changed in memory (hands removed,
grippers and frames added), and handed on as text, so that the kinematics and a
simulator see exactly the same robot.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from neugrasp_ros.errors import ConfigError, UnknownNameError
from neugrasp_ros.resources import config_dir

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """A frame given by its parent link.

    Attributes:
        parent: Link that carries the frame.
        xyz: Origin in the parent link in [m].
        rpy: Fixed-axis roll, pitch, yaw in the parent link in [rad].
    """

    parent: str
    xyz: Triple = (0.0, 0.0, 0.0)
    rpy: Triple = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperMount:
    """A gripper and its mounting face: x = approach, y = closing.

    Attributes:
        gripper: Name or path for ``load_gripper``.
        placement: The mounting face in its parent link.
    """

    gripper: str
    placement: Placement


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """Joints that move together.

    Attributes:
        joints: Joint names, base first.
        tcp_frame: Frame that is brought to a grasp; empty for a group without a hand.
        gripper: Key of the mounted gripper; empty where the URDF brings the hand.
    """

    joints: tuple[str, ...]
    tcp_frame: str = ""
    gripper: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionLimits:
    """Acceleration and jerk, which a URDF does not hold, per joint unit.

    Attributes:
        acceleration: In [rad/s2] or [m/s2].
        jerk: In [rad/s3] or [m/s3].
    """

    acceleration: float
    jerk: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotDescription:
    """All that a robot's YAML file says.

    Attributes:
        name: Name of the robot.
        urdf: The file.
        base_frame: Frame in which poses are given.
        remove_links: Links that are taken off, with their subtrees.
        grippers: Mounted grippers by key, such as ``left``.
        frames: Frames to add, by name.
        groups: Planning groups, by name.
        home: Joint values of the resting posture in [rad] or [m].
        motion_limits: By joint, and ``default``.
        self_collision_exclusions: Pairs of links that may touch.
    """

    name: str
    urdf: Path
    base_frame: str
    remove_links: tuple[str, ...] = ()
    grippers: Mapping[str, GripperMount] = field(default_factory=dict)
    frames: Mapping[str, Placement] = field(default_factory=dict)
    groups: Mapping[str, Group]
    home: Mapping[str, float] = field(default_factory=dict)
    motion_limits: Mapping[str, MotionLimits] = field(default_factory=dict)
    self_collision_exclusions: tuple[tuple[str, str], ...] = ()

    @property
    def arms(self) -> tuple[str, ...]:
        """Names of the groups that carry a hand."""
        return tuple(name for name, group in self.groups.items() if group.tcp_frame)


def load_description(
    name_or_path: str | Path, urdf: Path | None = None
) -> RobotDescription:
    """Load a robot by its shipped name or from a YAML file.

    Args:
        name_or_path: Name of a file in ``config/robots`` or a path ending in ``.yaml``.
        urdf: A URDF to read in place of the one that the YAML names.

    Raises:
        UnknownNameError: If there is no such robot.
        ConfigError: If the file misses a key, has an unknown one, or names a URDF or
            package that is not there.
    """
    path = Path(name_or_path)
    folder = config_dir() / "robots"
    if path.suffix not in (".yaml", ".yml"):
        path = folder / f"{name_or_path}.yaml"
    if not path.is_file():
        known = (p.stem for p in folder.glob("*.yaml"))
        raise UnknownNameError("robot", str(name_or_path), known)
    values = yaml.safe_load(path.read_text())
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected a mapping")
    try:
        if urdf is not None:
            values["urdf"] = {"path": str(urdf)}
        return _parse(values, path.parent)
    except (TypeError, KeyError, AttributeError) as error:
        raise ConfigError(f"{path}: bad or missing entry: {error}") from error


def _parse(values: dict[str, Any], folder: Path) -> RobotDescription:
    known = {item.name for item in fields(RobotDescription)}
    if set(values) - known:
        raise ConfigError(
            f"unknown {sorted(set(values) - known)}; known: {sorted(known)}"
        )
    grippers = {
        key: GripperMount(gripper=entry.pop("gripper"), placement=_placement(entry))
        for key, entry in values.get("grippers", {}).items()
    }
    groups = {
        key: Group(**{**entry, "joints": tuple(entry["joints"])})
        for key, entry in values["groups"].items()
    }
    for key, group in groups.items():
        if group.gripper and group.gripper not in grippers:
            raise ConfigError(
                f"group {key}: gripper {group.gripper!r} is none of {sorted(grippers)}"
            )
    limits = {
        key: MotionLimits(**entry)
        for key, entry in values.get("motion_limits", {}).items()
    }
    return RobotDescription(
        name=values["name"],
        urdf=_find_urdf(values["urdf"], folder),
        base_frame=values["base_frame"],
        remove_links=tuple(values.get("remove_links", ())),
        grippers=grippers,
        frames={k: _placement(v) for k, v in values.get("frames", {}).items()},
        groups=groups,
        home=dict(values.get("home", {})),
        motion_limits=limits,
        self_collision_exclusions=tuple(
            (first, second)
            for first, second in values.get("self_collision_exclusions", ())
        ),
    )


def _placement(entry: Mapping[str, Any]) -> Placement:
    triples: dict[str, Triple] = {}
    for key in ("xyz", "rpy"):
        if key in entry:
            x, y, z = (float(value) for value in entry[key])
            triples[key] = (x, y, z)
    extra = set(entry) - {"parent", "xyz", "rpy"}
    if extra:
        raise ConfigError(f"unknown {sorted(extra)}; known: parent, rpy, xyz")
    return Placement(parent=entry["parent"], **triples)


def _find_urdf(entry: Mapping[str, str], folder: Path) -> Path:
    if "path" in entry:
        path = folder / entry["path"]  # an absolute path stays itself
    else:
        path = _in_distribution(entry["distribution"], entry["file"])
    if not path.is_file():
        raise ConfigError(f"no robot description at {path}")
    return path


def _in_distribution(name: str, file: str) -> Path:
    """Find a file of an installed distribution without importing it."""
    try:
        entries = metadata.files(name) or []
    except metadata.PackageNotFoundError as error:
        raise ConfigError(f"the package {name} is not installed") from error
    for entry in entries:
        if entry.as_posix().endswith("/" + file):
            return Path(str(entry.locate()))
    raise ConfigError(f"the package {name} holds no {file}")
