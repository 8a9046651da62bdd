# SPDX-License-Identifier: Apache-2.0
"""Mugs and bottles with labelled parts, standing.

Labels of a mug: ``handle``, ``body``, ``rim`` (the upper third of the wall). Labels of
a bottle: ``body``, ``neck`` (with cap or pump), ``handle`` of a can or jug,
``loop`` to carry it by.
"""

from collections.abc import Callable

import numpy as np

from sim_bridge.objects.model import Part
from sim_bridge.objects.shapes.assembly import Shape
from sim_bridge.objects.shapes.building import (
    Section,
    arc_path,
    box,
    cup,
    cylinder,
    disc,
    loft,
    moved,
    rod,
    sweep,
    wall,
)

CERAMIC = 1700.0  # densities in [kg/m^3]
METAL_CUP = 2200.0
FILLED = 600.0
HALF_FILLED = 330.0
HANDLE, BODY, RIM = "handle", "body", "rim"
NECK, LOOP = "neck", "loop"
RIM_SHARE = 0.34  # of a mug's height that counts as its rim
WALL = 0.004  # [m]
N_WEDGES = 10  # per ring of a mug: few enough for fast physics


def _mug_body(
    foot: float, belly: float, top: float, height: float, depth: float = 1.0
) -> list[Part]:
    """Return a cup whose wall changes its label at the foot of the rim."""
    seam = (1 - RIM_SHARE) * height
    lower: list[Section] = [(0, foot, depth * foot), (seam, belly, depth * belly)]
    upper: list[Section] = [lower[1], (height, top, depth * top)]
    inner = [(z, x - WALL, y - WALL) for z, x, y in upper]
    return [
        *cup(lower, WALL, BODY, n_wedges=N_WEDGES),
        *wall(inner, upper, RIM, n_wedges=N_WEDGES),
    ]


def _ear(
    x: tuple[float, float], z: tuple[float, float], reach: float, *,
    square: bool = False, size: tuple[float, float] = (0.012, 0.008),
) -> list[Part]:  # fmt: skip
    """Return a handle in the xz plane between two points on a wall."""
    if square:
        out = max(x) + reach
        corners = [[x[0], 0, z[0]], [out, 0, z[0]], [out, 0, z[1]], [x[1], 0, z[1]]]
        return sweep(np.array(corners), size, (0, 1, 0), HANDLE)
    middle, half = (z[0] + z[1]) / 2, (z[1] - z[0]) / 2
    path = arc_path((0, 0, middle), (reach, half), (-np.pi / 2, np.pi / 2), 6)
    path[:, 0] += np.linspace(*x, len(path))
    return sweep(path, size, (0, 1, 0), HANDLE)


def _handled_mug(
    rng: np.random.Generator, radius: float, height: float, *, square: bool
) -> Shape:
    foot = radius * rng.uniform(0.82, 1.0)
    belly = foot + 0.66 * (radius - foot)
    low, high = rng.uniform(0.14, 0.25), rng.uniform(0.72, 0.9)
    walls = tuple(foot + (radius - foot) * t - WALL / 2 for t in (low, high))
    size = (rng.uniform(0.009, 0.015), rng.uniform(0.007, 0.01))
    ends = (low * height, high * height)
    ear = _ear((walls[0], walls[1]), ends, rng.uniform(0.026, 0.038), square=square,
               size=size)  # fmt: skip
    return Shape([*_mug_body(foot, belly, radius, height), *ear], CERAMIC)


def make_round_handle_mug(rng: np.random.Generator) -> Shape:
    """Coffee mug with a D-shaped ear."""
    radius, height = rng.uniform(0.033, 0.042), rng.uniform(0.08, 0.1)
    return _handled_mug(rng, radius, height, square=False)


def make_square_handle_mug(rng: np.random.Generator) -> Shape:
    """Coffee mug with an angular ear."""
    radius, height = rng.uniform(0.033, 0.042), rng.uniform(0.078, 0.1)
    return _handled_mug(rng, radius, height, square=True)


def make_handleless_mug(rng: np.random.Generator) -> Shape:
    """Tumbler: a conical cup without an ear."""
    top, height = rng.uniform(0.032, 0.039), rng.uniform(0.085, 0.12)
    foot = top * rng.uniform(0.68, 0.95)
    return Shape(_mug_body(foot, foot + 0.66 * (top - foot), top, height), CERAMIC)


def make_espresso_mug(rng: np.random.Generator) -> Shape:
    """Small cup with a small ear."""
    radius, height = rng.uniform(0.026, 0.032), rng.uniform(0.05, 0.065)
    return _handled_mug(rng, radius, height, square=bool(rng.random() < 0.4))


def make_tankard(rng: np.random.Generator) -> Shape:
    """Beer mug: tall, straight, with a tall thick handle."""
    radius, height = rng.uniform(0.034, 0.04), rng.uniform(0.11, 0.135)
    ends = (height * 0.14, height * rng.uniform(0.85, 0.92))
    size = (rng.uniform(0.014, 0.019), rng.uniform(0.009, 0.012))
    x = radius - WALL / 2
    ear = _ear((x, x), ends, rng.uniform(0.034, 0.042), size=size,
               square=bool(rng.random() < 0.5))  # fmt: skip
    return Shape([*_mug_body(radius, radius, radius, height), *ear], CERAMIC)


def make_barrel_mug(rng: np.random.Generator) -> Shape:
    """Belly wider than rim and foot, round ear."""
    foot, height = rng.uniform(0.026, 0.031), rng.uniform(0.075, 0.095)
    belly, top = foot + rng.uniform(0.006, 0.01), foot + rng.uniform(0.002, 0.006)
    ear = _ear((foot + 0.002, top), (0.22 * height, 0.86 * height),
               rng.uniform(0.03, 0.038))  # fmt: skip
    return Shape([*_mug_body(foot, belly, top, height), *ear], CERAMIC)


def make_enamel_mug(rng: np.random.Generator) -> Shape:
    """Camping mug: straight, low, with a rolled edge and a thin strap as an ear."""
    radius, height = rng.uniform(0.036, 0.043), rng.uniform(0.065, 0.08)
    edge = wall([disc(height - 0.004, radius - WALL), disc(height, radius - WALL)],
                [disc(height - 0.004, radius + 0.002), disc(height, radius + 0.002)],
                RIM)  # fmt: skip
    x = radius - WALL / 2
    ear = _ear((x, x), (0.18 * height, 0.84 * height), rng.uniform(0.026, 0.034),
               size=(rng.uniform(0.014, 0.018), 0.006))  # fmt: skip
    return Shape([*_mug_body(radius, radius, radius, height), *edge, *ear], METAL_CUP)


def make_teacup(rng: np.random.Generator) -> Shape:
    """Low, flaring cup on a foot ring with a pointed ear."""
    top, height = rng.uniform(0.04, 0.047), rng.uniform(0.05, 0.062)
    foot, belly = 0.5 * top, top * rng.uniform(0.85, 0.92)
    ends = (0.35 * height, 0.9 * height)
    ear = _ear(
        (0.7 * top, 0.94 * top), ends, rng.uniform(0.022, 0.028), size=(0.01, 0.007)
    )
    ring = cylinder(foot * 0.9, 0.006, (0, 0, -0.003), "z", BODY)
    return Shape([*_mug_body(foot, belly, top, height), ring, *ear], CERAMIC)


def make_mixed_mug(rng: np.random.Generator) -> Shape:
    """Any cup, round or oval, with no ear, one, or two, perhaps on a stem."""
    radius, height = rng.uniform(0.027, 0.043), rng.uniform(0.045, 0.13)
    foot = radius * rng.uniform(0.55, 1.05)
    belly = radius * rng.uniform(0.9, 1.12)
    depth = rng.uniform(0.8, 1.0) if rng.random() < 0.3 else 1.0
    parts = _mug_body(foot, belly, radius, height, depth)
    seam = (1 - RIM_SHARE) * height
    low, high = rng.uniform(0.1, 0.45) * height, rng.uniform(0.68, 0.94) * height
    ends = tuple(
        float(np.interp(z, [0, seam, height], [foot, belly, radius])) - WALL / 2
        for z in (low, high)
    )
    size = (rng.uniform(0.008, 0.02), rng.uniform(0.006, 0.012))
    ear = _ear((ends[0], ends[1]), (low, high), rng.uniform(0.02, 0.042),
               square=bool(rng.random() < 0.4), size=size)  # fmt: skip
    n_ears = rng.choice(3, p=(0.2, 0.6, 0.2))
    parts += [p for k in range(n_ears) for p in moved(ear, euler=(0, 0, k * np.pi))]
    if rng.random() < 0.2:
        stem, rise = rng.uniform(0.3, 0.9) * foot, rng.uniform(0.006, 0.035)
        parts.append(cylinder(stem, rise, (0, 0, 0.002 - rise / 2), "z", BODY))
        base = rng.uniform(0.8, 1.1) * foot
        parts.append(cylinder(max(base, stem), 0.005, (0, 0, -rise), "z", BODY))
    return Shape(parts, CERAMIC)


def _necked(
    half: tuple[float, float], neck: float, heights: tuple[float, float, float],
    squareness: float = 2.0,
) -> list[Part]:  # fmt: skip
    """Return body and neck with cap; heights of shoulder, neck's foot and top."""
    x, y = half
    shoulder, foot, top = heights
    sections: list[Section] = [
        (0, 0.9 * x, 0.9 * y), (0.006, x, y), (shoulder, x, y), disc(foot, neck)
    ]  # fmt: skip
    return [
        loft(sections, BODY, squareness),
        cylinder(neck, top - foot, (0, 0, (top + foot) / 2), "z", NECK),
        cylinder(neck + 0.0025, 0.016, (0, 0, top), "z", NECK),
    ]


def make_wine_bottle(rng: np.random.Generator) -> Shape:
    """Slim: a long neck on round shoulders."""
    radius, height = rng.uniform(0.028, 0.036), rng.uniform(0.17, 0.21)
    shoulder = height * rng.uniform(0.5, 0.58)
    heights = (shoulder, shoulder + rng.uniform(0.02, 0.04), height)
    return Shape(_necked((radius, radius), rng.uniform(0.011, 0.014), heights), FILLED)


def make_water_bottle(rng: np.random.Generator) -> Shape:
    """Drinking bottle: wide body with a waist, short neck, big cap."""
    radius, height = rng.uniform(0.029, 0.036), rng.uniform(0.14, 0.185)
    waist, shoulder = radius * rng.uniform(0.8, 0.95), 0.8 * height
    low = [disc(0, 0.93 * radius), disc(0.005, radius), disc(0.35 * height, radius)]
    middle = disc(0.45 * height, waist)
    high = [disc(0.55 * height, radius), disc(shoulder, radius)]
    lower = loft([*low, middle], BODY)
    upper = loft([middle, *high, disc(0.9 * height, 0.015)], BODY)
    cap = cylinder(0.016, 0.12 * height, (0, 0, 0.94 * height), "z", NECK)
    return Shape([lower, upper, cap], FILLED)


def make_square_bottle(rng: np.random.Generator) -> Shape:
    """Oil or sauce bottle with a square body."""
    x, height = rng.uniform(0.023, 0.031), rng.uniform(0.13, 0.19)
    shoulder = height * rng.uniform(0.55, 0.68)
    heights = (shoulder, shoulder + rng.uniform(0.012, 0.025), height)
    neck = rng.uniform(0.01, 0.013)
    return Shape(_necked((x, x), neck, heights, squareness=7.0), FILLED)


def make_flask(rng: np.random.Generator) -> Shape:
    """Flat oval bottle, such as shampoo."""
    x, y = rng.uniform(0.031, 0.04), rng.uniform(0.017, 0.024)
    height = rng.uniform(0.12, 0.17)
    shoulder = height * rng.uniform(0.68, 0.78)
    heights = (shoulder, shoulder + 0.018, height)
    squareness = rng.uniform(2.0, 3.5)
    return Shape(_necked((x, y), rng.uniform(0.01, 0.015), heights, squareness), FILLED)


def make_canister(rng: np.random.Generator) -> Shape:
    """Detergent bottle with a handle at its side."""
    x, y = rng.uniform(0.03, 0.038), rng.uniform(0.022, 0.029)
    height = rng.uniform(0.14, 0.18)
    shoulder = height * rng.uniform(0.58, 0.66)
    heights = (shoulder, shoulder + 0.03, height)
    ends = (0.2 * height, shoulder)
    ear = _ear((x - 0.004, x - 0.004), ends, rng.uniform(0.03, 0.036),
               size=(0.017, 0.012), square=bool(rng.random() < 0.5))  # fmt: skip
    return Shape([*_necked((x, y), 0.013, heights, 4.0), *ear], HALF_FILLED)


def make_sports_bottle(rng: np.random.Generator) -> Shape:
    """Bottle with a wide lid and a loop on it to carry it by."""
    radius, height = rng.uniform(0.029, 0.035), rng.uniform(0.12, 0.16)
    low = [disc(0, 0.93 * radius), disc(0.006, radius)]
    body = loft([*low, disc(0.9 * height, radius), disc(height, 0.8 * radius)], BODY)
    lid = cylinder(0.85 * radius, 0.02, (0, 0, height + 0.008), "z", NECK)
    z, reach = height + 0.014, rng.uniform(0.034, 0.042)
    arc = arc_path((0, 0, z), (0.8 * radius, reach), (0, np.pi), 8)
    loop = sweep(arc, (rng.uniform(0.012, 0.018), 0.007), (0, 1, 0), LOOP)
    return Shape([body, lid, *loop], FILLED)


def make_pump_bottle(rng: np.random.Generator) -> Shape:
    """Soap dispenser: a low body and a pump with a spout."""
    x, y = rng.uniform(0.027, 0.035), rng.uniform(0.023, 0.031)
    height = rng.uniform(0.09, 0.12)
    sections: list[Section] = [(0, x, y), (0.85 * height, x, y), disc(height, 0.016)]
    body = loft(sections, BODY, rng.choice([2.0, 5.0]))
    stem = rod((0, 0, height), (0, 0, height + 0.036), 0.006, NECK)
    collar = cylinder(0.015, 0.014, (0, 0, height + 0.005), "z", NECK)
    spout = box(
        (rng.uniform(0.034, 0.044), 0.014, 0.011), (0.012, 0, height + 0.04), NECK
    )
    return Shape([body, collar, stem, spout], FILLED)


def make_decanter(rng: np.random.Generator) -> Shape:
    """Round belly, slender neck, ball-shaped stopper."""
    belly, height = rng.uniform(0.035, 0.042), rng.uniform(0.13, 0.165)
    neck = rng.uniform(0.011, 0.014)
    sections: list[Section] = [disc(0, 0.6 * belly), disc(0.022, 0.95 * belly),
                disc(0.036, belly), disc(0.05, 0.93 * belly),
                disc(0.085, 1.2 * neck)]  # fmt: skip
    tube = cylinder(neck, height - 0.08, (0, 0, (height + 0.08) / 2), "z", NECK)
    lip = loft([disc(height - 0.012, neck), disc(height, 1.5 * neck)], NECK)
    stopper = rod((0, 0, height + 0.004), (0, 0, height + 0.012), 0.013, NECK)
    return Shape([loft(sections, BODY), tube, lip, stopper], FILLED)


def make_mixed_bottle(rng: np.random.Generator) -> Shape:
    """Any body, neck and cap, perhaps with a handle at the side or a loop on top."""
    x = rng.uniform(0.022, 0.042)
    y = x * (rng.uniform(0.55, 1.0) if rng.random() < 0.5 else 1.0)
    squareness = rng.choice([2.0, 2.0, 3.0, 5.0, 8.0])
    height = rng.uniform(0.05, 0.145)
    factors = rng.uniform(0.72, 1.0, 3)
    factors /= factors.max()
    levels = (0.0, rng.uniform(0.3, 0.7) * height, height)
    foot, middle, top = (
        (z, f * x, f * y) for z, f in zip(levels, factors.tolist(), strict=True)
    )
    neck = min(rng.uniform(0.008, 0.018), 0.8 * top[2])
    mouth = height + rng.uniform(0.003, 0.035)
    rim = mouth + rng.uniform(0.006, 0.05)
    cap = (neck * rng.uniform(1.05, 1.9), rng.uniform(0.008, 0.028))
    parts = [
        loft([foot, middle], BODY, squareness),
        loft([middle, top, disc(mouth, neck)], BODY, squareness),
        cylinder(neck, rim - mouth + 0.004, (0, 0, (mouth + rim) / 2), "z", NECK),
        cylinder(cap[0], cap[1], (0, 0, rim), "z", NECK),
    ]
    if rng.random() < 0.3:
        low, high = rng.uniform(0.1, 0.35) * height, rng.uniform(0.7, 0.98) * height
        ends = np.interp((low, high), levels, factors * x) - 0.004
        reach = rng.uniform(0.024, 0.038)
        size = (rng.uniform(0.01, 0.02), rng.uniform(0.008, 0.013))
        square = bool(rng.random() < 0.5)
        parts += _ear((ends[0], ends[1]), (low, high), reach, square=square, size=size)
    elif rng.random() < 0.3:
        reach = rng.uniform(0.03, 0.042)
        arc = arc_path((0, 0, rim), (max(cap[0] - 0.003, 0.012), reach), (0, np.pi), 8)
        parts += sweep(arc, (rng.uniform(0.009, 0.018), 0.007), (0, 1, 0), LOOP)
    return Shape(parts, FILLED if rng.random() < 0.7 else HALF_FILLED)


MUGS: dict[str, Callable[[np.random.Generator], Shape]] = {
    "round_handle": make_round_handle_mug,
    "square_handle": make_square_handle_mug,
    "no_handle": make_handleless_mug,
    "espresso": make_espresso_mug,
    "tankard": make_tankard,
    "barrel": make_barrel_mug,
    "enamel": make_enamel_mug,
    "teacup": make_teacup,
}

BOTTLES: dict[str, Callable[[np.random.Generator], Shape]] = {
    "wine": make_wine_bottle,
    "water": make_water_bottle,
    "square": make_square_bottle,
    "flask": make_flask,
    "canister": make_canister,
    "sports": make_sports_bottle,
    "pump": make_pump_bottle,
    "decanter": make_decanter,
}
