# SPDX-License-Identifier: Apache-2.0
"""Where the files that ship with the package lie."""

import os
import sys
from pathlib import Path

from neugrasp_ros.errors import ConfigError


def config_dir() -> Path:
    """Return the folder of the shipped configuration files.

    Looks in the source tree, then in the share folder of the environment, then in the
    prefixes of an ament workspace.

    Raises:
        ConfigError: If none of them holds it.
    """
    source = Path(__file__).resolve().parent.parent
    prefixes = [sys.prefix, *os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)]
    shares = [Path(p) / "share" / "neugrasp_ros" for p in prefixes if p]
    for root in (source, *shares):
        if (root / "config" / "grippers").is_dir():
            return root / "config"
    raise ConfigError(f"no config folder in {[str(r) for r in (source, *shares)]}")


def weights_dir() -> Path:
    """Return the folder of the shipped network weights."""
    return Path(__file__).resolve().parent / "weights"


def parameter_file(name_or_path: str) -> str:
    """Return the path of a file of parameters, given as a path or by its shipped name.

    Args:
        name_or_path: A path, or a file of ``config/`` with or without ``.yaml``.

    Raises:
        ConfigError: If there is no such file.
    """
    shipped = config_dir() / name_or_path
    candidates = (Path(name_or_path), shipped, shipped.with_suffix(".yaml"))
    for candidate in candidates:
        if candidate.is_file():
            return str(candidate.resolve())
    raise ConfigError(f"no such file: {', '.join(map(str, candidates))}")
