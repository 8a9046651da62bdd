# SPDX-License-Identifier: Apache-2.0
"""The ``procedural`` set: our own household shapes, made from their names."""

from collections.abc import Callable

import numpy as np

from neugrasp_ros.errors import UnknownNameError
from sim_bridge.objects.model import ObjectModel
from sim_bridge.objects.shapes import containers, solids, tools
from sim_bridge.objects.shapes.assembly import Shape, assemble, seeded

SET_NAME = "procedural"
N_PER_FAMILY = 12  # names listed; any number can be loaded

FAMILIES: dict[str, Callable[[np.random.Generator], Shape]] = {
    name.removeprefix("make_"): getattr(module, name)
    for module in (containers, solids, tools)
    for name in vars(module)
    if name.startswith("make_")
}


def procedural_names() -> list[str]:
    """Return the names of the set: every family, numbered from 000."""
    return [f"{f}_{k:03d}" for f in sorted(FAMILIES) for k in range(N_PER_FAMILY)]


def load_procedural(name: str) -> ObjectModel:
    """Make the object of a name such as ``mug_017``; the name is the seed.

    Raises:
        UnknownNameError: If the family is not known or the number is none.
    """
    family, _, number = name.rpartition("_")
    if family not in FAMILIES or not (number.isascii() and number.isdigit()):
        raise UnknownNameError(
            "procedural object", name, [f"{family}_<number>" for family in FAMILIES]
        )
    return assemble(FAMILIES[family](seeded(name)), name, SET_NAME, family)
