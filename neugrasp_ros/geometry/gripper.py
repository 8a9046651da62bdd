# SPDX-License-Identifier: Apache-2.0
"""Parallel-jaw grippers as one value that every other part reads."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, UnknownNameError
from neugrasp_ros.resources import config_dir

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Gripper:
    """A two-finger gripper in its own frame (z approach, y closing, origin at the TCP).

    The TCP is the midpoint of the pad tips with open jaws.

    Attributes:
        name: Name by which messages and files refer to it.
        max_opening: Distance of the inner pad faces with open jaws in [m].
        finger_depth: Palm front plane to pad tips along z in [m].
        finger_thickness: Extent of a finger along x in [m].
        finger_width: Extent of a finger along y, outside its pad face, in [m].
        palm_size: Extents x, y, z of the box behind the palm front plane in [m].
        mount_to_tcp: Mounting face to TCP along z in [m].
        max_force: Rated closing force of one finger in [N].
        tip_advance: How far the tips move along z when the jaws close fully, in [m].
    """

    name: str
    max_opening: float
    finger_depth: float
    finger_thickness: float
    finger_width: float
    palm_size: tuple[float, float, float]
    mount_to_tcp: float
    max_force: float
    tip_advance: float = 0.0

    def __post_init__(self) -> None:
        """Reject measures that no gripper has.

        Raises:
            ConfigError: If a length or force is not positive, or beyond 1 m.
        """
        object.__setattr__(self, "palm_size", tuple(float(v) for v in self.palm_size))
        if len(self.palm_size) != 3:
            raise ConfigError(f"palm_size: expected x, y, z, got {self.palm_size}")
        lengths = {
            item: getattr(self, item)
            for item in (
                "max_opening", "finger_depth", "finger_thickness", "finger_width",
                "mount_to_tcp",
            )
        }  # fmt: skip
        lengths |= {f"palm_size[{i}]": v for i, v in enumerate(self.palm_size)}
        for item, value in lengths.items():
            if not 0.0 < value <= 1.0:
                raise ConfigError(
                    f"gripper {self.name!r}: {item} must be in (0, 1] m, got {value}"
                )
        if not 0.0 <= self.tip_advance <= self.finger_depth:
            raise ConfigError(
                f"gripper {self.name!r}: tip_advance must be in [0, finger_depth], "
                f"got {self.tip_advance}"
            )
        if not 0 < self.max_force < np.inf:
            raise ConfigError(
                f"gripper {self.name!r}: max_force must be positive, "
                f"got {self.max_force}"
            )

    def boxes(self, opening: float | None = None) -> tuple[FloatArray, FloatArray]:
        """Return the hand as boxes in the gripper frame: left, right finger, palm.

        Args:
            opening: Distance of the inner pad faces in [m]; default fully open.

        Returns:
            Centres (3, 3) and half extents (3, 3), in [m]. The left finger is at +y.
        """
        opening = self.max_opening if opening is None else opening
        lateral = (opening + self.finger_width) / 2
        finger = np.array([self.finger_thickness, self.finger_width, self.finger_depth])
        palm_z = -self.finger_depth - self.palm_size[2] / 2
        centers = np.array(
            [
                [0.0, lateral, -self.finger_depth / 2],
                [0.0, -lateral, -self.finger_depth / 2],
                [0.0, 0.0, palm_z],
            ]
        )
        return centers, np.stack([finger, finger, np.array(self.palm_size)]) / 2


def gripper_names() -> tuple[str, ...]:
    """Return the names of the grippers that ship with the package."""
    return tuple(sorted(p.stem for p in (config_dir() / "grippers").glob("*.yaml")))


def load_gripper(name_or_path: str | Path) -> Gripper:
    """Load a gripper by its shipped name or from a YAML file.

    Args:
        name_or_path: A name of ``gripper_names()`` or a path ending in ``.yaml``.

    Raises:
        UnknownNameError: If there is no such gripper or file.
        ConfigError: If the file is not YAML, misses a field, or has an unknown or
            absurd one.
    """
    path = Path(name_or_path)
    if path.suffix not in (".yaml", ".yml"):
        path = config_dir() / "grippers" / f"{name_or_path}.yaml"
    if not path.is_file():
        raise UnknownNameError("gripper", str(name_or_path), gripper_names())
    try:
        values = yaml.safe_load(path.read_text())
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: not YAML ({error})") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected a mapping of gripper measures")
    return gripper_from(values, str(path))


def gripper_from(values: Mapping[str, Any], source: str) -> Gripper:
    """Make a gripper of plain values, as a file has them.

    Args:
        values: The fields of ``Gripper`` by name.
        source: Where the values came from, for errors.

    Raises:
        ConfigError: If a field is missing, unknown, or absurd.
    """
    known = {item.name for item in fields(Gripper)}
    if set(values) - known:
        raise ConfigError(
            f"{source}: unknown {sorted(set(values) - known)}; known: {sorted(known)}"
        )
    missing = known - set(values) - {"tip_advance"}
    if missing:
        raise ConfigError(f"{source}: missing {sorted(missing)}")
    try:
        return Gripper(**values)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"{source}: {error}") from error


def varied_gripper(rng: np.random.Generator) -> Gripper:
    """Draw a gripper that nobody builds, between and around those that are built.

    A network that is trained with such grippers reads the measures instead of
    learning two of them by heart.
    """
    depth = float(rng.uniform(0.035, 0.075))
    palm = (
        float(rng.uniform(0.05, 0.09)),
        float(rng.uniform(0.09, 0.21)),
        float(rng.uniform(0.07, 0.11)),
    )
    return Gripper(
        name="varied",
        max_opening=float(rng.uniform(0.05, 0.14)),
        finger_depth=depth,
        finger_thickness=float(rng.uniform(0.012, 0.028)),
        finger_width=float(rng.uniform(0.010, 0.022)),
        palm_size=palm,
        mount_to_tcp=depth + palm[2],
        max_force=float(rng.uniform(15.0, 50.0)),
    )
