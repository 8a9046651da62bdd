# SPDX-License-Identifier: Apache-2.0
"""Household containers: cans, bottles, jars, bowls, mugs, plates."""

import numpy as np

from sim_bridge.objects.model import Part
from sim_bridge.objects.shapes.assembly import Shape
from sim_bridge.objects.shapes.building import (
    arc_path,
    box,
    cup,
    cylinder,
    disc,
    loft,
    rod,
    sphere,
    sweep,
)

CERAMIC = 1800.0  # densities in [kg/m^3]
PLASTIC = 1100.0
FILLED = 700.0  # a closed container with air in it
HALF_FILLED = 350.0


def make_can(rng: np.random.Generator) -> Shape:
    """Tin: a cylinder, sometimes with raised rims."""
    radius, height = rng.uniform(0.022, 0.038), rng.uniform(0.035, 0.125)
    body = cylinder(radius, height, (0, 0, 0))
    if rng.random() < 0.5:
        return Shape([body], FILLED)
    lip = rng.uniform(0.001, 0.002)
    rims = [cylinder(radius + lip, 0.004, (0, 0, z * height / 2)) for z in (-1, 1)]
    return Shape([body, *rims], FILLED)


def make_bottle(rng: np.random.Generator) -> Shape:
    """Round, oval or square bottle with shoulder, neck and cap."""
    x, height = rng.uniform(0.02, 0.036), rng.uniform(0.09, 0.17)
    y = x * rng.choice([1.0, rng.uniform(0.6, 0.9)])
    squareness = rng.choice([2.0, 2.0, 5.0])
    neck = min(x, y) * rng.uniform(0.35, 0.6)
    shoulder, rise = height * rng.uniform(0.5, 0.75), rng.uniform(0.008, 0.035)
    top = shoulder + rise
    body = loft(
        [(0, 0.92 * x, 0.92 * y), (0.005, x, y), (shoulder, x, y), disc(top, neck)],
        squareness=squareness,
    )
    stem = cylinder(neck, height - top, (0, 0, (height + top) / 2))
    cap = cylinder(neck * 1.25, 0.018, (0, 0, height))
    return Shape([body, stem, cap], rng.uniform(HALF_FILLED, FILLED))


def make_jar(rng: np.random.Generator) -> Shape:
    """Wide jar with a screw lid."""
    radius, height = rng.uniform(0.024, 0.038), rng.uniform(0.05, 0.11)
    body = loft(
        [disc(0, 0.9 * radius), disc(0.006, radius),
         disc(0.85 * height, radius), disc(height, 0.85 * radius)]
    )  # fmt: skip
    lid_height = rng.uniform(0.01, 0.022)
    lid = cylinder(radius * rng.uniform(0.85, 1.0), lid_height, (0, 0, height))
    return Shape([body, lid], FILLED)


def make_bowl(rng: np.random.Generator) -> Shape:
    """Round bowl, flaring upwards."""
    top, height = rng.uniform(0.042, 0.065), rng.uniform(0.028, 0.055)
    foot, thickness = top * rng.uniform(0.45, 0.7), rng.uniform(0.0035, 0.006)
    belly = foot + (top - foot) * rng.uniform(0.6, 0.9)
    sections = [disc(0, foot), disc(0.45 * height, belly), disc(height, top)]
    return Shape(cup(sections, thickness), CERAMIC)


def side_handle(
    rng: np.random.Generator, x: float, z: tuple[float, float], square: bool
) -> list[Part]:
    """Return a mug's handle in the xz plane.

    Args:
        rng: Source of randomness.
        x: Where the wall is in [m].
        z: Heights of its ends in [m].
        square: Whether it has corners instead of an arc.
    """
    reach, width = rng.uniform(0.026, 0.036), rng.uniform(0.009, 0.014)
    middle, half = (z[0] + z[1]) / 2, (z[1] - z[0]) / 2
    if square:
        path = np.array(
            [[x, 0, z[0]], [x + reach, 0, z[0]], [x + reach, 0, z[1]], [x, 0, z[1]]]
        )
    else:
        path = arc_path((x, 0, middle), (reach, half), (-np.pi / 2, np.pi / 2), 6)
    return sweep(path, (width, rng.uniform(0.006, 0.009)), (0, 1, 0))


def make_mug(rng: np.random.Generator) -> Shape:
    """Mug with a round or a square handle."""
    radius, height = rng.uniform(0.03, 0.043), rng.uniform(0.06, 0.105)
    taper, thickness = rng.uniform(0.8, 1.0), rng.uniform(0.0035, 0.005)
    foot = radius * taper
    body = cup([disc(0, foot), disc(height, radius)], thickness)
    ends = (height * rng.uniform(0.15, 0.25), height * rng.uniform(0.75, 0.88))
    wall_x = foot + 0.3 * (radius - foot) - thickness / 2
    return Shape([*body, *side_handle(rng, wall_x, ends, rng.random() < 0.5)], CERAMIC)


def make_cup(rng: np.random.Generator) -> Shape:
    """Tumbler without a handle, straight or conical."""
    top, height = rng.uniform(0.028, 0.04), rng.uniform(0.05, 0.12)
    foot = top * rng.uniform(0.65, 1.0)
    thickness = rng.uniform(0.003, 0.0045)
    return Shape(cup([disc(0, foot), disc(height, top)], thickness), PLASTIC)


def make_plate(rng: np.random.Generator) -> Shape:
    """Shallow plate or saucer with a raised rim."""
    top, height = rng.uniform(0.05, 0.085), rng.uniform(0.012, 0.024)
    foot, thickness = top * rng.uniform(0.55, 0.75), rng.uniform(0.004, 0.006)
    return Shape(cup([disc(0, foot), disc(height, top)], thickness), CERAMIC)


def make_lid(rng: np.random.Generator) -> Shape:
    """Pot lid: a flat dome with a knob."""
    radius, rise = rng.uniform(0.035, 0.065), rng.uniform(0.01, 0.02)
    dome = loft([disc(0, radius), disc(0.004, radius), disc(rise, 0.4 * radius)])
    stem = cylinder(0.006, 0.016, (0, 0, rise + 0.006))
    knob_at = (0, 0, rise + 0.02)
    size = rng.uniform(0.009, 0.014)
    knob = (
        sphere(size, knob_at) if rng.random() < 0.5 else cylinder(size, 0.01, knob_at)
    )
    return Shape([dome, stem, knob], CERAMIC)


def make_spray_bottle(rng: np.random.Generator) -> Shape:
    """Cleaner bottle with a trigger head."""
    x, y = rng.uniform(0.028, 0.036), rng.uniform(0.018, 0.028)
    height = rng.uniform(0.09, 0.125)
    body = loft([(0, x, y), (0.65 * height, x, y), disc(height, 0.013)], "", 3.0)
    neck = cylinder(0.012, 0.022, (0, 0, height + 0.008))
    nozzle, z = rng.uniform(0.026, 0.036), height + 0.028
    head = box((nozzle + 0.02, 0.02, 0.02), (nozzle / 2 - 0.01, 0, z))
    tip = cylinder(0.007, 0.01, (nozzle + 0.004, 0, z + 0.002), "x")
    trigger = rod((nozzle - 0.012, 0, z - 0.008), (nozzle - 0.004, 0, z - 0.036), 0.004)
    return Shape([body, neck, head, tip, trigger], HALF_FILLED)


def make_squeeze_bottle(rng: np.random.Generator) -> Shape:
    """Mustard bottle: an oval body and a pointed cap."""
    x, y = rng.uniform(0.026, 0.036), rng.uniform(0.017, 0.026)
    height = rng.uniform(0.08, 0.13)
    body = loft(
        [(0, 0.95 * x, 0.95 * y), (0.3 * height, x, y),
         (0.8 * height, 0.9 * x, 0.9 * y), (height, 0.45 * x, 0.55 * y)]
    )  # fmt: skip
    collar = cylinder(0.55 * y, 0.012, (0, 0, height + 0.004))
    tip = loft([disc(height + 0.008, 0.45 * y), disc(height + 0.036, 0.003)])
    return Shape([body, collar, tip], FILLED)


def make_tube(rng: np.random.Generator) -> Shape:
    """Toothpaste tube standing on its cap: a round end that turns flat."""
    radius, height = rng.uniform(0.014, 0.021), rng.uniform(0.1, 0.15)
    body = loft([disc(0.02, radius), (height, 1.35 * radius, 0.0035)])
    cap = cylinder(radius * rng.uniform(0.75, 1.0), 0.024, (0, 0, 0.012))
    return Shape([body, cap], FILLED)


def make_pot(rng: np.random.Generator) -> Shape:
    """Small cooking pot or pan with one long handle."""
    radius, height = rng.uniform(0.04, 0.058), rng.uniform(0.028, 0.055)
    body = cup([disc(0, 0.9 * radius), disc(height, radius)], 0.004)
    length, size = rng.uniform(0.06, 0.1), (rng.uniform(0.014, 0.022), 0.011)
    rise, x = rng.uniform(0.0, 0.02), 0.96 * radius
    path = [[x, 0, 0.8 * height], [x + length, 0, 0.8 * height + rise]]
    return Shape([*body, *sweep(np.array(path), size, (0, 1, 0))], CERAMIC)


def make_pitcher(rng: np.random.Generator) -> Shape:
    """Jug with a spout and a big handle."""
    top, height = rng.uniform(0.032, 0.042), rng.uniform(0.1, 0.14)
    belly = top * rng.uniform(1.0, 1.15)
    sections = [disc(0, 0.9 * belly), disc(0.5 * height, belly),
                disc(height, top)]  # fmt: skip
    body = cup(sections, 0.004, n_wedges=10)
    handle = side_handle(rng, 0.97 * top, (0.3 * height, 0.85 * height), False)
    lip = [[-0.9 * top, 0, height - 0.012], [-1.35 * top, 0, height]]
    spout = sweep(np.array(lip), (0.018, 0.006), (0, 1, 0))
    return Shape([*body, *handle, *spout], PLASTIC)


def make_carton(rng: np.random.Generator) -> Shape:
    """Milk carton: a box with a gable."""
    x, y = rng.uniform(0.022, 0.034, size=2)
    height, gable = rng.uniform(0.07, 0.12), rng.uniform(0.015, 0.03)
    body = box((2 * x, 2 * y, height), (0, 0, height / 2))
    roof = loft([(height, x, y), (height + gable, x, 0.002)], "", 12.0)
    crest = box((2 * x, 0.005, 0.012), (0, 0, height + gable + 0.004))
    return Shape([body, roof, crest], FILLED)
