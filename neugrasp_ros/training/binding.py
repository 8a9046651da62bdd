# SPDX-License-Identifier: Apache-2.0
"""A run's folder belongs to one training: what it was begun with stays.

What lies there, rendered scenes and the states of stages, is found by name and gone on
with. In another training's folder it would be used for what it is not.
"""

import json
import os
import zlib
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from types import MappingProxyType
from typing import Any

from neugrasp_ros.config import NetworkConfig, TrainConfig
from neugrasp_ros.datagen.labels import SceneLabels
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.model import file_sha256

RUN_FILE = "run.json"
FREE = ("steps", "checkpoint_seconds", "threads", "device")
"""Settings of a stage that may change when it goes on."""
SETTINGS = MappingProxyType({"network": NetworkConfig, "stage": TrainConfig})


def bind_folder(
    folder: Path,
    network: NetworkConfig,
    stages: Sequence[TrainConfig],
    start: Path | None,
    scenes: dict[str, Sequence[SceneLabels]],
) -> None:
    """Write what a training is into its folder, or compare with what is there.

    Scenes and stages may be added, and a stage may get other ``FREE`` settings.

    Args:
        folder: The run's; made if it is missing.
        network: Shape of the network.
        stages: The stages to run.
        start: Weights to begin with.
        scenes: The scenes by what they are for.

    Raises:
        ConfigError: If the folder was begun with something else.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / RUN_FILE
    asked: dict[str, dict[str, Any]] = {
        "network": asdict(network),
        "start": {"weights": file_sha256(start) if start else "none"},
        **{f"stage {stage.stage}": _bound(stage) for stage in stages},
        **{
            f"{use} scene": {str(s.index): _digest(s) for s in some}
            for use, some in scenes.items()
        },
    }
    asked = json.loads(json.dumps(asked))
    before = json.loads(path.read_text()) if path.is_file() else {}
    for group in sorted(before.keys() & asked.keys()):
        for name, value in {**_defaults(group, asked), **before[group]}.items():
            if asked[group].get(name) != value:
                raise ConfigError(
                    f"{folder} was begun with {group} {name} = {value}, got "
                    f"{asked[group].get(name)}: go on with what it was, or take a new "
                    "folder"
                )
    part = path.with_suffix(".part")
    part.write_text(json.dumps({**before, **asked}) + "\n")
    os.replace(part, path)


def _defaults(group: str, asked: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return what settings that are younger than a folder were: their defaults."""
    settings = SETTINGS.get(group.partition(" ")[0])
    if settings is None:
        return {}
    values = json.loads(json.dumps(asdict(settings())))
    return {name: values[name] for name in asked[group]}


def _bound(stage: TrainConfig) -> dict[str, Any]:
    return {name: value for name, value in asdict(stage).items() if name not in FREE}


def _digest(labels: SceneLabels) -> str:
    """Return a short digest of a scene and its grasps."""
    recipe = json.dumps(labels.scene.as_record(), sort_keys=True).encode()
    digest = zlib.crc32(recipe)
    grasps = labels.grasps
    for column in (grasps.positions, grasps.quaternions, grasps.labels):
        digest = zlib.crc32(column.tobytes(), digest)
    return f"{digest:08x}"
