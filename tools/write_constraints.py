# SPDX-License-Identifier: Apache-2.0
"""Writes constraints.txt from an environment that passed `make test`.

Run as ``.venv/bin/python tools/write_constraints.py > constraints.txt``.
"""

import importlib.metadata
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEADER = """\
# What the pinned packages bring along, as it was when they were tried together.
# Written by tools/write_constraints.py in an environment that passed `make test`."""


def canonical(name: str) -> str:
    """Return a distribution's name as pip compares it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pinned_directly() -> set[str]:
    """Return the names that the requirement files pin."""
    lines = [
        line.split("#")[0].strip()
        for name in ("requirements.txt", "requirements-dev.txt")
        for line in (ROOT / name).read_text().splitlines()
    ]
    return {canonical(re.split(r"[\[=]", line)[0]) for line in lines if line}


def main() -> None:
    """Print one ``name==version`` for each package that pip brought along."""
    ours = pinned_directly() | {"pip", "neugrasp-msgs", "neugrasp-ros"}
    pins = set()
    for package in importlib.metadata.distributions():
        # The ROS wheels carry metadata of parts that are no packages to pip.
        by_pip = (package.read_text("INSTALLER") or "").strip() == "pip"
        if by_pip and canonical(package.name) not in ours:
            pins.add(f"{canonical(package.name)}=={package.version}")
    print(HEADER, *sorted(pins), sep="\n")


if __name__ == "__main__":
    main()
