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
