# SPDX-License-Identifier: Apache-2.0
"""The ``affordance`` set: seven categories whose parts say what they are for."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from neugrasp_ros.errors import UnknownNameError
from sim_bridge.objects.model import ObjectModel
from sim_bridge.objects.shapes import bags, cutting, vessels, wearables
from sim_bridge.objects.shapes.assembly import Shape, assemble, seeded

SET_NAME = "affordance"
FIRST_HELD_OUT_SEED = 1_000_000
N_SEEDS = 200  # listed per style; any other can be loaded
N_HELD_OUT_SEEDS = 24  # listed per style for testing

STYLES: Mapping[str, Mapping[str, Callable[[np.random.Generator], Shape]]] = (
    MappingProxyType(
        {
            "knife": cutting.KNIVES,
            "scissors": cutting.SCISSORS,
            "mug": vessels.MUGS,
            "bottle": vessels.BOTTLES,
            "bag": bags.BAGS,
            "earphone": wearables.EARPHONES,
            "hat": wearables.HATS,
        }
    )
)


MIXED = "mixed"  # a style to learn from alone, of which no two objects are alike
MIXED_SET_NAME = "affordance_mixed"
N_MIXED = 2000  # listed per category
MIXED_MAKERS: Mapping[str, Callable[[np.random.Generator], Shape]] = MappingProxyType(
    {
        "knife": cutting.make_mixed_knife,
        "scissors": cutting.make_mixed_scissors,
        "mug": vessels.make_mixed_mug,
        "bottle": vessels.make_mixed_bottle,
        "bag": bags.make_mixed_bag,
        "earphone": wearables.make_mixed_earphone,
        "hat": wearables.make_mixed_hat,
    }
)


class AffordanceName(NamedTuple):
    """The three fields of a name such as ``mug/square_handle/000123``."""

    category: str
    style: str
    seed: int

    def __str__(self) -> str:
        """Return the name."""
        return f"{self.category}/{self.style}/{self.seed:06d}"


def parse_name(name: str) -> AffordanceName:
    """Take a name apart.

    Raises:
        UnknownNameError: If category or style is unknown or the seed is no number.
    """
    category, _, rest = name.partition("/")
    style, _, seed = rest.partition("/")
    if category not in STYLES or style not in (*STYLES[category], MIXED):
        known = [f"{c}/{s}/<seed>" for c in STYLES for s in (*STYLES[c], MIXED)]
        raise UnknownNameError("affordance object", name, known)
    if not (seed.isascii() and seed.isdigit()):
        raise UnknownNameError(
            "affordance object", name, [f"{category}/{style}/<seed>"]
        )
    return AffordanceName(category, style, int(seed))


def held_out_style(category: str) -> str:
    """Return the style of a category that is never trained or tuned on: its last."""
    return list(STYLES[category])[-1]


def is_held_out(name: str) -> bool:
    """Tell whether an object is for testing only, by its style or by its seed."""
    category, style, seed = parse_name(name)
    return style == held_out_style(category) or seed >= FIRST_HELD_OUT_SEED


def affordance_names(n_seeds: int = N_SEEDS) -> list[str]:
    """Return names to train on: every style but the held-out, seeds from 0."""
    return [
        str(AffordanceName(category, style, seed))
        for category, styles in STYLES.items()
        for style in styles
        if style != held_out_style(category)
        for seed in range(n_seeds)
    ]


def mixed_names(n_seeds: int = N_MIXED) -> list[str]:
    """Return names to train on of the style ``mixed``, which is never tested on."""
    return [
        str(AffordanceName(category, MIXED, seed))
        for category in MIXED_MAKERS
        for seed in range(n_seeds)
    ]


def held_out_names(
    n_seeds: int = N_HELD_OUT_SEEDS, *, styles: str = "all"
) -> list[str]:
    """Return names to test on, with seeds from 1,000,000.

    Args:
        n_seeds: Seeds per style.
        styles: ``new`` for the held-out styles alone, ``known`` for the styles that
            were trained on, ``all`` for both.

    Raises:
        UnknownNameError: If ``styles`` is none of these.
    """
    wanted = {"all": (True, False), "new": (True,), "known": (False,)}
    if styles not in wanted:
        raise UnknownNameError("kind of styles", styles, wanted)
    return [
        str(AffordanceName(category, style, FIRST_HELD_OUT_SEED + seed))
        for category, makers in STYLES.items()
        for style in makers
        if (style == held_out_style(category)) in wanted[styles]
        for seed in range(n_seeds)
    ]


def load_affordance(name: str) -> ObjectModel:
    """Make the object of a name such as ``mug/square_handle/000123``.

    Raises:
        UnknownNameError: If the name is not of that form.
    """
    parsed = parse_name(name)
    if parsed.style == MIXED:
        make = MIXED_MAKERS[parsed.category]
    else:
        make = STYLES[parsed.category][parsed.style]
    shape = make(seeded(str(parsed)))
    return assemble(shape, name, SET_NAME, parsed.category, parsed.style)
