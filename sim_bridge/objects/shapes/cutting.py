# SPDX-License-Identifier: Apache-2.0
"""Knives and scissors with labelled handles and blades, lying flat.

Labels: ``handle`` of a pointed tool, ``blunt_handle`` of one that cannot stab,
``blade``. Blades are 3 to 4 mm thick, about twice the real thing, so that the physics
engine and a depth camera notice them.
"""

from collections.abc import Callable

import numpy as np

from sim_bridge.objects.model import Part
from sim_bridge.objects.shapes.assembly import Shape
from sim_bridge.objects.shapes.building import (
    arc_path,
    box,
    cylinder,
    moved,
    rod,
    sheet,
    sweep,
)

METAL_AND_PLASTIC = 1600.0  # density [kg/m^3]
POINTED, BLUNT, BLADE = "handle", "blunt_handle", "blade"

CHILD_BLADE = (0.055, 0.014)  # [m] at most as long, at least as wide

Outline = list[tuple[float, float]]


def _blade(outline: Outline, thickness: float) -> Part:
    return sheet(outline, thickness, BLADE)


def _grip(
    rng: np.random.Generator, length: float, width: float, label: str
) -> list[Part]:
    """Return a knife handle along -x from the origin, of one of three make-ups."""
    thickness = rng.uniform(0.013, 0.02)
    kind = rng.integers(3)
    if kind == 0:
        return [box((length, width, thickness), (-length / 2, 0, 0), label)]
    bend = rng.uniform(-0.003, 0.006)
    swell = np.array([[0, 0, 0], [-0.3, 0, 0], [-0.75, bend, 0], [-1, bend - 0.002, 0]])
    path = swell * (length, 1, 1)
    return sweep(path, (thickness, width), (0, 0, 1), label, round_section=kind == 2)


def _knife(
    rng: np.random.Generator,
    outline: Outline,
    grip: tuple[float, float],
    label: str = POINTED,
) -> Shape:
    length, width = grip
    parts = [_blade(outline, rng.uniform(0.003, 0.004))]
    parts += _grip(rng, length, width, label)
    if rng.random() < 0.4:
        parts.append(box((0.008, 1.1 * width, 0.017), (0, 0, 0), label))
    return Shape(parts, METAL_AND_PLASTIC)


def make_chef_knife(rng: np.random.Generator) -> Shape:
    """Broad blade with a belly that rises to the point."""
    length, width = rng.uniform(0.1, 0.135), rng.uniform(0.03, 0.042)
    top = 0.011
    outline = [(0, top), (0.75 * length, top), (length, 0.35 * top - 0.3 * width),
               (0.8 * length, top - 0.75 * width), (0.5 * length, top - width),
               (0.0, top - width)]  # fmt: skip
    return _knife(rng, outline, (rng.uniform(0.085, 0.11), rng.uniform(0.02, 0.026)))


def make_paring_knife(rng: np.random.Generator) -> Shape:
    """Short slim blade, straight edge."""
    length, width = rng.uniform(0.065, 0.09), rng.uniform(0.018, 0.024)
    outline = [(0, 0.45 * width), (0.6 * length, 0.35 * width),
               (length, -0.45 * width), (0.0, -0.5 * width)]  # fmt: skip
    return _knife(rng, outline, (rng.uniform(0.08, 0.1), rng.uniform(0.016, 0.021)))


def make_table_knife(rng: np.random.Generator) -> Shape:
    """Cutlery with a round tip: it cuts, it does not stab."""
    length, width = rng.uniform(0.08, 0.105), rng.uniform(0.018, 0.023)
    angles = np.linspace(-np.pi / 2, np.pi / 2, 6)
    tip = [(length - width / 2 + width / 2 * float(np.cos(t)),
            width / 2 * float(np.sin(t))) for t in angles]  # fmt: skip
    outline = [(0, -0.4 * width), *tip, (0, 0.4 * width)]
    grip = (rng.uniform(0.085, 0.105), rng.uniform(0.015, 0.019))
    return _knife(rng, outline, grip, BLUNT)


def make_cleaver(rng: np.random.Generator) -> Shape:
    """Nearly rectangular blade without a point."""
    length, width = rng.uniform(0.095, 0.13), rng.uniform(0.05, 0.07)
    outline = [(0, 0.012), (length, 0.012), (length, 0.012 - width),
               (0.004, 0.012 - width)]  # fmt: skip
    grip = (rng.uniform(0.085, 0.11), rng.uniform(0.021, 0.027))
    return _knife(rng, outline, grip, BLUNT)


def make_bread_knife(rng: np.random.Generator) -> Shape:
    """Long even blade with a square, blunt end."""
    length, width = rng.uniform(0.13, 0.15), rng.uniform(0.022, 0.03)
    outline = [(0, 0.5 * width), (length, 0.4 * width), (length, -0.35 * width),
               (0.95 * length, -0.5 * width), (0, -0.5 * width)]  # fmt: skip
    grip = (rng.uniform(0.08, 0.1), rng.uniform(0.021, 0.027))
    return _knife(rng, outline, grip, BLUNT)


def make_steak_knife(rng: np.random.Generator) -> Shape:
    """Narrow blade that curves up to a point."""
    length, width = rng.uniform(0.09, 0.115), rng.uniform(0.016, 0.021)
    outline = [(0, 0.5 * width), (0.7 * length, 0.5 * width), (length, 0.75 * width),
               (0.75 * length, -0.3 * width), (0.2 * length, -0.5 * width),
               (0, -0.5 * width)]  # fmt: skip
    return _knife(rng, outline, (rng.uniform(0.085, 0.105), rng.uniform(0.017, 0.022)))


def make_dagger(rng: np.random.Generator) -> Shape:
    """Symmetric double edge with a cross guard and a pommel."""
    length, width = rng.uniform(0.095, 0.13), rng.uniform(0.024, 0.032)
    outline = [(0, width / 2), (0.6 * length, 0.4 * width), (length, 0),
               (0.6 * length, -0.4 * width), (0, -width / 2)]  # fmt: skip
    grip = rng.uniform(0.08, 0.095)
    guard = box((0.009, rng.uniform(0.045, 0.06), 0.014), (-0.004, 0, 0), POINTED)
    bar = rod((-0.008, 0, 0), (-grip, 0, 0), rng.uniform(0.0085, 0.011), POINTED)
    pommel = cylinder(0.012, 0.018, (-grip - 0.004, 0, 0), "z", POINTED)
    blade = _blade(outline, rng.uniform(0.003, 0.004))
    return Shape([blade, guard, bar, pommel], METAL_AND_PLASTIC)


def _loop(
    center: tuple[float, float], radii: tuple[float, float], size: tuple[float, float],
    label: str,
) -> list[Part]:  # fmt: skip
    path = arc_path((*center, 0), radii, (0, 2 * np.pi), 10, "xy")
    return sweep(path, size, (0, 0, 1), label)


def _scissor_half(
    blade: tuple[float, float], shank: float, loop: tuple[float, float],
    thickness: float, label: str,
) -> list[Part]:  # fmt: skip
    """Return one half: blade along +x, shank and finger loop along -x, offset to +y."""
    length, width = blade
    outline = [(-0.006, -0.2 * width), (length, -0.1 * width), (length, 0.1 * width),
               (0.4 * length, 0.75 * width), (-0.006, 0.8 * width)]  # fmt: skip
    if label == BLUNT:
        outline[1:3] = [(length - 0.003, -0.2 * width), (length, 0.25 * width)]
    offset = loop[1] + 0.004
    path = np.array([[0, 0, 0], [-0.4 * shank, -0.35 * offset, 0],
                     [-shank, -0.75 * offset, 0]])  # fmt: skip
    bar = sweep(path, (thickness, 0.01), (0, 0, 1), label)
    center = (-shank - 0.75 * loop[0], -offset)
    ring = _loop(center, loop, (thickness, 0.007), label)
    return [sheet(outline, 0.0035, BLADE), *bar, *ring]


def _scissors(
    rng: np.random.Generator,
    blade: tuple[float, float],
    shank: float,
    loops: tuple[tuple[float, float], tuple[float, float]],
    label: str = POINTED,
    extras: tuple[list[Part], list[Part]] = ([], []),
) -> Shape:
    """Cross two halves, each with its extra parts, at a pivot; draw their opening."""
    thickness, opening = rng.uniform(0.009, 0.013), rng.uniform(0.02, 0.3)
    one = _scissor_half(blade, shank, loops[0], thickness, label) + extras[0]
    other = _scissor_half(blade, shank, loops[1], thickness, label) + extras[1]
    other = moved(other, euler=(np.pi, 0, 0))
    half = opening / 2
    return Shape(
        [
            *moved(one, (0, 0, 0.0017), (0, 0, half)),
            *moved(other, (0, 0, -0.0017), (0, 0, -half)),
            cylinder(0.006, 0.011, (0, 0, 0), "z", BLADE),
        ],
        METAL_AND_PLASTIC,
    )


def make_household_scissors(rng: np.random.Generator) -> Shape:
    """Two equal oval loops."""
    loop = (rng.uniform(0.018, 0.024), rng.uniform(0.013, 0.017))
    blade = (rng.uniform(0.065, 0.09), rng.uniform(0.012, 0.017))
    return _scissors(rng, blade, rng.uniform(0.03, 0.04), (loop, loop))


def make_tailor_scissors(rng: np.random.Generator) -> Shape:
    """Long blades, one loop for the thumb and a longer one for four fingers."""
    blade = (rng.uniform(0.085, 0.105), rng.uniform(0.016, 0.021))
    thumb, fingers = (0.018, 0.015), (rng.uniform(0.028, 0.036), 0.017)
    return _scissors(rng, blade, rng.uniform(0.028, 0.036), (thumb, fingers))


def make_child_scissors(rng: np.random.Generator) -> Shape:
    """Short with round tips: they cut, they do not stab."""
    radius = rng.uniform(0.016, 0.02)
    blade = rng.uniform(0.04, CHILD_BLADE[0]), rng.uniform(CHILD_BLADE[1], 0.019)
    loop = (radius, radius * 0.9)
    return _scissors(rng, blade, rng.uniform(0.022, 0.03), (loop, loop), BLUNT)


def make_hair_scissors(rng: np.random.Generator) -> Shape:
    """Slim blades, small round loops and a finger rest."""
    loop = (0.014, 0.0135)
    blade, shank = (rng.uniform(0.06, 0.075), 0.01), rng.uniform(0.045, 0.055)
    x, y = -shank - 1.6 * loop[0], -loop[1] - 0.004
    rest = rod((x, y, 0), (x - 0.018, y - 0.008, 0), 0.004, POINTED)
    return _scissors(rng, blade, shank, (loop, loop), extras=([rest], []))


def make_kitchen_shears(rng: np.random.Generator) -> Shape:
    """Stout blades and thick grips instead of thin loops."""
    blade = (rng.uniform(0.065, 0.085), rng.uniform(0.018, 0.023))
    loop = (rng.uniform(0.026, 0.032), rng.uniform(0.014, 0.017))
    shank = rng.uniform(0.022, 0.03)
    at = (-shank - 0.75 * loop[0], -2 * loop[1] - 0.004, 0)
    grip = box((1.6 * loop[0], 0.011, 0.015), at, POINTED)
    return _scissors(rng, blade, shank, (loop, loop), extras=([grip], [grip]))


def make_embroidery_scissors(rng: np.random.Generator) -> Shape:
    """Small and ornate: wide loops on short shanks, needle-like blades."""
    radius = rng.uniform(0.016, 0.021)
    blade = (rng.uniform(0.045, 0.06), rng.uniform(0.009, 0.012))
    loop = (radius, radius)
    return _scissors(rng, blade, rng.uniform(0.018, 0.026), (loop, loop))


def make_mixed_knife(rng: np.random.Generator) -> Shape:
    """Any blade, pointed or blunt, on any handle, straight or at an angle to it."""
    length = rng.uniform(0.055, 0.145)
    width = rng.uniform(0.015, 0.04) if rng.random() < 0.8 else rng.uniform(0.04, 0.065)
    grip = (rng.uniform(0.07, 0.115), rng.uniform(0.015, 0.028))
    top = min(rng.uniform(0.3, 0.6) * width, 0.5 * grip[1])
    low = top - width
    pointed = bool(rng.random() < 0.55)
    near = [
        (rng.uniform(0.3, 0.85) * length, top - rng.uniform(0, 0.15) * width),
        (rng.uniform(0.4, 0.9) * length, low + rng.uniform(0, 0.25) * width),
    ]
    if pointed:
        tip = [(length, top - rng.uniform(0, 1) * width)]
    else:
        end, drop = rng.uniform(0.4, 0.9) * width, rng.uniform(0, 0.1) * width
        cut = rng.uniform(0, 0.25) * end
        tip = [
            (length - cut, top - drop),
            (length, top - drop - cut),
            (length, top - drop - end + cut),
            (length - cut, top - drop - end),
        ]
    label = POINTED if pointed else BLUNT
    handle = _grip(rng, *grip, label)
    if rng.random() < 0.35:
        bolster = (rng.uniform(0.006, 0.016), rng.uniform(0.9, 1.5) * grip[1], 0.017)
        handle.append(box(bolster, (-bolster[0] / 4, 0, 0), label))
    if rng.random() < 0.3:
        cap = (rng.uniform(0.008, 0.016), rng.uniform(0.9, 1.3) * grip[1], 0.016)
        handle.append(box(cap, (-grip[0], 0, 0), label))
    if rng.random() < 0.3:
        handle = moved(handle, euler=(0, 0, rng.uniform(-0.3, 0.3)))
    blade = _blade(
        [(-0.004, top), *near, *tip, (-0.004, low)], rng.uniform(0.003, 0.004)
    )
    return Shape([blade, *handle], METAL_AND_PLASTIC)


def make_mixed_scissors(rng: np.random.Generator) -> Shape:
    """Any blades between any two loops, with or without stout grips.

    Most blades of the measures of children's scissors have round tips, as those have.
    """
    blade = (rng.uniform(0.042, 0.105), rng.uniform(0.0095, 0.023))
    shank = rng.uniform(0.02, 0.052)
    one = (rng.uniform(0.014, 0.034), rng.uniform(0.013, 0.019))
    other = one
    if rng.random() < 0.5:
        other = (rng.uniform(0.014, 0.034), rng.uniform(0.013, 0.019))
    is_stubby = blade[0] < CHILD_BLADE[0] and blade[1] > CHILD_BLADE[1]
    label = BLUNT if rng.random() < (0.8 if is_stubby else 0.15) else POINTED
    extras: list[list[Part]] = []
    stout = rng.random() < 0.3
    for loop in (one, other):
        at = (-shank - 0.75 * loop[0], -2 * loop[1] - 0.004, 0)
        size = (rng.uniform(1.2, 1.8) * loop[0], 0.011, rng.uniform(0.013, 0.017))
        extras.append([box(size, at, label)] if stout else [])
    return _scissors(rng, blade, shank, (one, other), label, (extras[0], extras[1]))


KNIVES: dict[str, Callable[[np.random.Generator], Shape]] = {
    "chef": make_chef_knife,
    "paring": make_paring_knife,
    "table": make_table_knife,
    "cleaver": make_cleaver,
    "bread": make_bread_knife,
    "steak": make_steak_knife,
    "dagger": make_dagger,
}

SCISSORS: dict[str, Callable[[np.random.Generator], Shape]] = {
    "household": make_household_scissors,
    "tailor": make_tailor_scissors,
    "child": make_child_scissors,
    "hair": make_hair_scissors,
    "kitchen_shears": make_kitchen_shears,
    "embroidery": make_embroidery_scissors,
}
