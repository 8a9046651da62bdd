# SPDX-License-Identifier: Apache-2.0
"""Every default of the library, as frozen dataclasses.

Each field carries its meaning and unit in ``metadata["doc"]`` and, where it is a
number, its range in ``metadata["range"]``; the ROS nodes declare their parameters from
the same table.
"""

from dataclasses import dataclass, field, fields, is_dataclass
from numbers import Integral
from pathlib import Path
from typing import Any, TypeVar

import yaml

from neugrasp_ros.errors import ConfigError

Config = TypeVar("Config", bound="Checked")


def option(
    default: Any,
    doc: str,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a documented, checked dataclass field.

    Args:
        default: Default value.
        doc: Meaning and unit.
        low: Smallest value allowed.
        high: Largest value allowed.
        choices: Words allowed, for a string.
    """
    metadata: dict[str, Any] = {"doc": doc}
    if low is not None and high is not None:
        metadata["range"] = (low, high)
    if choices:
        metadata["choices"] = choices
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Checked:
    """Base that checks each field against its declared range or choices."""

    def __post_init__(self) -> None:
        """Reject a value out of range.

        Raises:
            ConfigError: Naming the field, the value and what is allowed.
        """
        for item in fields(self):
            value = getattr(self, item.name)
            bounds = item.metadata.get("range")
            if bounds and item.type is int and not isinstance(value, Integral):
                raise ConfigError(f"{item.name} must be a whole number, got {value!r}")
            if bounds and not bounds[0] <= value <= bounds[1]:
                raise ConfigError(
                    f"{item.name} must be in [{bounds[0]}, {bounds[1]}], got {value}"
                )
            choices = item.metadata.get("choices")
            if choices and value not in choices:
                raise ConfigError(
                    f"{item.name} must be one of {', '.join(choices)}, got {value!r}"
                )


@dataclass(frozen=True, kw_only=True)
class NetworkConfig(Checked):
    """Shape of the network; stored inside every weights file."""

    encoder: str = option("voxel", "Encoder's name in the registry")
    stem: str = option(
        "axis", "How a plane sees its dropped axis", choices=("axis", "conv3d")
    )
    resolution: int = option(64, "Voxels per edge of the input volume", 8, 256)
    plane_resolution: int = option(32, "Cells per edge of a feature plane", 4, 256)
    channels: int = option(32, "Channels C of a feature plane", 4, 512)
    unet: str = option("plain", "Blocks of the U-Net", choices=("plain", "residual"))
    unet_depth: int = option(3, "Levels of the U-Net shared by the planes", 1, 6)
    unet_channels: int = option(32, "Channels of its first level", 4, 256)
    occupancy_hidden: int = option(48, "Width of the occupancy decoder", 8, 1024)
    occupancy_blocks: int = option(4, "Residual blocks of the occupancy decoder", 1, 10)
    detector: str = option("neugrasp", "Detector's name in the registry")
    decoder: str = option("pointnet", "Its point decoder's name in the registry")
    point_features: str = option(
        "shared", "Plane features of local points", choices=("shared", "none")
    )
    local_points: int = option(128, "Local surface points per grasp", 16, 4096)
    local_view: str = option(
        "rendered",
        "What the detector reads: the local surface, fixed points, or the TCP alone",
        choices=("rendered", "grid", "centre"),
    )
    pointnet_width: int = option(64, "Width of the first PointNet layer", 8, 512)
    pointnet_out: int = option(256, "Width of the pooled PointNet feature", 16, 2048)
    affordances: tuple[str, ...] = option((), "Affordance classes that have a head")
    part_head: bool = option(
        False, "Learn also what the part at every surface point affords"
    )
    thing_head: bool = option(
        False, "Teach the context also what any part of the thing at a point affords"
    )
    context: int = option(
        0, "Features of the surroundings for the affordance head; 0 = none", 0, 512
    )
    hand_view: int = option(
        0, "Features of the view along the hand for the same; 0 = none", 0, 512
    )

    def __post_init__(self) -> None:
        """Check every field, and that heads and context have what they need.

        Raises:
            ConfigError: Naming the field, the value and what is allowed.
        """
        super().__post_init__()
        if self.part_head and not self.affordances:
            raise ConfigError("part_head needs affordances, got none")
        if self.context and not self.affordances:
            raise ConfigError("context needs affordances, got none")
        if self.thing_head and not self.context:
            raise ConfigError("thing_head needs a context, got none")
        if self.hand_view and not self.context:
            raise ConfigError("hand_view needs a context, got none")

    @property
    def context_width(self) -> int:
        """How much the affordance head is told of a point's surroundings.

        These are the features, then the probability of each class at that point.
        """
        return self.context + len(self.affordances) if self.context else 0

    @property
    def hand_width(self) -> int:
        """How much the affordance head is told of the view along a hand."""
        return self.hand_view + len(self.affordances) if self.hand_view else 0


CPU_NETWORK = NetworkConfig(unet="residual", unet_depth=4, unet_channels=64)
"""The size that is trained without a GPU; a weights file says which it has."""

PAPER_NETWORK = NetworkConfig(
    stem="conv3d",
    plane_resolution=64,
    channels=128,
    unet_depth=5,
    unet_channels=64,
    occupancy_hidden=256,
    occupancy_blocks=5,
    local_points=1023,
    pointnet_out=1024,
)
"""The paper's size (method sheet, c2)."""


@dataclass(frozen=True, kw_only=True)
class RenderConfig(Checked):
    """Virtual cameras that look at the implicit scene, and at each grasp."""

    cameras: int = option(6, "Scene cameras, evenly spaced in azimuth", 1, 32)
    elevation_deg: float = option(60.0, "Their elevation [deg]", 0.0, 90.0)
    radius: float = option(0.6, "Distance to the cube's centre [m]", 0.2, 5.0)
    image_size: int = option(48, "Rows and columns of a scene camera [pixel]", 4, 512)
    fov_deg: float = option(45.0, "Field of view of a scene camera [deg]", 5.0, 150.0)
    point_spacing: float = option(0.005, "Spacing of the merged cloud [m]", 0.001, 0.05)
    local_image_size: int = option(
        20, "Rows and columns of a local camera [pixel]", 4, 256
    )
    local_fov_deg: float = option(
        120.0, "Field of view of a local camera [deg]", 30.0, 150.0
    )


@dataclass(frozen=True, kw_only=True)
class ReferenceConfig(Checked):
    """The paper's scene cameras, for the reference renderer (method sheet, d2)."""

    cameras: int = option(6, "Scene cameras, evenly spaced in azimuth", 1, 32)
    elevation_deg: float = option(60.0, "Their elevation [deg]", 0.0, 89.0)
    radius: float = option(0.6, "Distance to the cube's foot [m]", 0.2, 5.0)
    image_size: int = option(64, "Rows and columns [pixel]", 4, 512)
    fov_deg: float = option(90.0, "Field of view [deg]", 5.0, 150.0)
    samples: int = option(256, "Samples of a ray", 2, 4096)
    far: float = option(0.9, "Where the last sample lies [m]", 0.1, 10.0)


@dataclass(frozen=True, kw_only=True)
class PlannerConfig(Checked):
    """The way from a volume to scored grasps."""

    weights: str = option("", "Weights file; empty = the one that ships")
    gripper: str = option("robotiq_2f85", "Gripper's name or its YAML file")
    device: str = option("cpu", "Torch device")
    threads: int = option(0, "Compute threads; 0 = all cores", 0, 256)
    max_candidates: int = option(256, "Candidates scored per decision", 1, 10000)
    renderer: str = option(
        "fast",
        "Fast; or, to compare with, the paper's to the letter: minutes a decision; or "
        "that with the compiled decoder, where something may be",
        choices=("fast", "reference", "compiled_reference"),
    )
    scene_render: bool = option(
        True,
        "Sample grasps on the completed surface; off, an ablation, on what was seen: "
        "the rendered cloud stays the completed one",
    )
    cube_overlap: float = option(
        0.1, "What the cubes of a large workspace share at least [m]", 0.0, 0.25
    )
    render: RenderConfig = field(
        default_factory=RenderConfig, metadata={"doc": "Virtual cameras"}
    )


@dataclass(frozen=True, kw_only=True)
class TrainConfig(Checked):
    """One training stage: what is trained, on how much, and how fast."""

    stage: str = option(
        "occupancy",
        "What is trained",
        choices=("occupancy", "quality", "joint", "hands", "context"),
    )
    steps: int = option(4000, "Optimiser steps", 1, 10_000_000)
    scenes_per_step: int = option(8, "Scenes that share one step", 1, 1024)
    points_per_scene: int = option(1536, "Occupancy points per scene", 16, 65536)
    point_scenes: int = option(
        3, "Scenes of which the context sees points alone, for each with grasps", 1, 64
    )
    grasps_per_scene: int = option(32, "Grasps per scene, sharing its encoding", 1, 512)
    learning_rate: float = option(1.5e-3, "AdamW step size at its height", 1e-7, 1.0)
    weight_decay: float = option(1e-4, "AdamW weight decay", 0.0, 1.0)
    constant_share: float = option(
        0.6, "Share of the steps before the step size falls linearly", 0.0, 1.0
    )
    w_occupancy: float = option(2.0, "Weight of the scene occupancy loss", 0.0, 100.0)
    w_overlap: float = option(
        1.0, "Weight of the loss of the scenes' intersection over union", 0.0, 100.0
    )
    stretched_share: float = option(
        0.5, "Share of the occupancy's scenes that are stretched", 0.0, 1.0
    )
    w_quality: float = option(1.0, "Weight of the quality loss", 0.0, 100.0)
    w_local: float = option(1.0, "Weight of the local occupancy loss", 0.0, 100.0)
    w_affordance: float = option(
        0.15, "Weight of the affordance loss, a sum over the classes", 0.0, 100.0
    )
    w_parts: float = option(
        1.0, "Weight of the losses of what part and thing at a point afford", 0.0, 100.0
    )
    w_hands: float = option(
        1.0, "Weight of the loss of what grasps afford by the view along the hand",
        0.0, 100.0,
    )  # fmt: skip
    hands_per_scene: int = option(
        6, "Grasps of a scene in a step for the view along the hand", 1, 512
    )
    seed: int = option(0, "Seed of every random choice", 0, 2**31 - 1)
    checkpoint_seconds: float = option(
        300.0, "Time between checkpoints [s]", 1.0, 600.0
    )
    threads: int = option(0, "Torch threads; 0 = all cores", 0, 256)
    device: str = option(
        "auto", "Where to train: a GPU if there is one", choices=("auto", "cpu", "cuda")
    )
    bfloat16: bool = option(True, "Mixed precision where the device is quick at it")


def load_config(config_type: type[Config], path: str | Path) -> Config:
    """Build a configuration from a flat YAML mapping of overrides.

    Args:
        config_type: A dataclass of this module.
        path: YAML file.

    Raises:
        ConfigError: If the file cannot be read or is not a mapping, a key is unknown
            or a value is out of range.
    """
    try:
        values = yaml.safe_load(Path(path).read_text()) or {}
    except (OSError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: not a readable YAML file ({error})") from error
    if not isinstance(values, dict):
        raise ConfigError(f"{path}: expected a mapping, got {type(values).__name__}")
    return override(config_type, values, where=str(path))


def override(config_type: type[Config], values: dict[str, Any], where: str) -> Config:
    """Build a configuration from overrides.

    Args:
        config_type: A dataclass of this module.
        values: Overrides; a part that is itself a configuration is a mapping.
        where: Where they stand, for messages.

    Raises:
        ConfigError: If a key is unknown (the known ones are listed) or a value is out
            of range or of the wrong type.
    """
    known = {item.name: item for item in fields(config_type)}
    unknown = sorted(set(values) - set(known))
    if unknown:
        raise ConfigError(f"{where}: unknown {unknown}; known: {sorted(known)}")
    given = {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    for name, value in given.items():
        if isinstance(value, dict) and is_dataclass(known[name].type):
            part: Any = known[name].type
            given[name] = override(part, value, f"{where}: {name}")
    try:
        return config_type(**given)
    except (ConfigError, TypeError) as error:
        raise ConfigError(f"{where}: {error}") from error
