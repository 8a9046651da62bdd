# SPDX-License-Identifier: Apache-2.0
"""Refuse counts on the command line that ask for nothing."""

import argparse

from neugrasp_ros.errors import ConfigError


def require_positive(args: argparse.Namespace, *names: str) -> None:
    """Check options that count something.

    Args:
        args: Of a command.
        names: Of the options, as attributes of ``args``.

    Raises:
        ConfigError: If one is below 1.
    """
    for name in names:
        count = getattr(args, name)
        if count < 1:
            option = name.replace("_", "-")
            raise ConfigError(f"--{option} must be positive, got {count}")
