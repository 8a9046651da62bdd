# SPDX-License-Identifier: Apache-2.0
"""Household and workshop tools, lying as they lie on a table."""

import numpy as np

from sim_bridge.objects.shapes.assembly import Shape
from sim_bridge.objects.shapes.building import (
    arc_path,
    box,
    cylinder,
    disc,
    ellipsoid,
    hull,
    loft,
    moved,
    ring,
    rod,
    sheet,
    sweep,
)

WOOD = 650.0  # densities in [kg/m^3]
STEEL_AND_WOOD = 1800.0
PLASTIC = 900.0
LYING = (0.0, np.pi / 2, 0.0)  # turns z to x


def make_hammer(rng: np.random.Generator) -> Shape:
    """Hammer: handle along x, head across it."""
    length, radius = rng.uniform(0.13, 0.2), rng.uniform(0.009, 0.014)
    handle = loft([(0, radius, 1.25 * radius), (length, 0.8 * radius, radius)])
    face, head = rng.uniform(0.011, 0.017), rng.uniform(0.055, 0.085)
    neck = box((0.024, head * 0.6, 1.5 * face), (length, 0, 0))
    peen = cylinder(face, head * 0.4, (length, head * 0.4, 0), "y")
    parts = [*moved([handle], euler=LYING), neck, peen]
    if rng.random() < 0.5:
        claw = [[length, -0.25 * head, 0], [length - 0.008, -0.75 * head, 0]]
        parts += sweep(np.array(claw), (1.4 * face, 0.009), (0, 0, 1))
    else:
        parts.append(cylinder(face, head * 0.4, (length, -head * 0.4, 0), "y"))
    return Shape(parts, STEEL_AND_WOOD)


def make_screwdriver(rng: np.random.Generator) -> Shape:
    """Screwdriver: fluted grip and a thin shaft."""
    grip, radius = rng.uniform(0.06, 0.1), rng.uniform(0.011, 0.017)
    shaft = rng.uniform(0.05, 0.1)
    handle = loft(
        [disc(0, 0.7 * radius), disc(0.1 * grip, radius),
         disc(0.7 * grip, 0.95 * radius), disc(grip, 0.55 * radius)]
    )  # fmt: skip
    rest = cylinder(rng.uniform(0.003, 0.0045), shaft, (0, 0, grip + shaft / 2))
    tip = loft([(grip + shaft, 0.005, 0.0035), (grip + shaft + 0.01, 0.005, 0.002)])
    return Shape(moved([handle, rest, tip], euler=LYING), STEEL_AND_WOOD)


def make_wrench(rng: np.random.Generator) -> Shape:
    """Open-ended spanner with a ring or a second jaw."""
    length, width = rng.uniform(0.11, 0.18), rng.uniform(0.012, 0.02)
    thickness, jaw = rng.uniform(0.01, 0.015), rng.uniform(0.016, 0.024)
    parts = [box((length, width, 0.8 * thickness))]
    for side in (-1, 1):
        x = side * (length / 2 + 0.4 * jaw)
        opening = 0.6 if side > 0 or rng.random() < 0.5 else 0.0
        turn = 0 if side > 0 else np.pi
        arc = arc_path(
            (x, 0, 0),
            (jaw, jaw),
            (turn + opening, turn + 2 * np.pi - opening),
            8,
            "xy",
        )
        parts += sweep(arc, (thickness, 0.6 * jaw), (0, 0, 1))
    return Shape(parts, 2500.0)


def make_brush(rng: np.random.Generator) -> Shape:
    """Brush: handle, block and bristles pointing down."""
    grip, block = rng.uniform(0.08, 0.12), rng.uniform(0.04, 0.08)
    width, thickness = rng.uniform(0.022, 0.045), rng.uniform(0.012, 0.018)
    bristles = rng.uniform(0.012, 0.025)
    z = bristles + thickness / 2
    handle = sweep(
        np.array([[0, 0, z], [-grip * 0.5, 0, z + 0.006], [-grip, 0, z + 0.002]]),
        (rng.uniform(0.016, 0.026), thickness), (0, 1, 0), round_section=True,
    )  # fmt: skip
    plate = box((block, width, thickness), (block / 2, 0, z))
    tuft = box((0.92 * block, 0.85 * width, bristles), (block / 2, 0, bristles / 2))
    return Shape([*handle, plate, tuft], WOOD)


def make_paintbrush(rng: np.random.Generator) -> Shape:
    """Flat brush: bristles, metal ferrule and a slim handle in one line."""
    width, thickness = rng.uniform(0.025, 0.055), rng.uniform(0.012, 0.018)
    grip = rng.uniform(0.08, 0.12)
    bristles = loft([(0, width / 2, 0.003), (0.045, width / 2, thickness / 2)], "", 6.0)
    ferrule = box((width, thickness, 0.024), (0, 0, 0.056))
    shoulder = loft([(0.066, width / 2, thickness / 2), (0.09, 0.01, 0.007)], "", 4.0)
    handle = loft([(0.088, 0.008, 0.007), (0.088 + grip, 0.011, 0.008)])
    return Shape(moved([bristles, ferrule, shoulder, handle], euler=LYING), WOOD)


def make_spoon(rng: np.random.Generator) -> Shape:
    """Spoon or ladle: a bowl of wedges on a long handle."""
    a, b = rng.uniform(0.022, 0.034), rng.uniform(0.017, 0.026)
    depth, length = rng.uniform(0.01, 0.018), rng.uniform(0.09, 0.14)
    rim = ring((depth, a, b), n_sides=10)
    inner = ring((depth, a - 0.004, b - 0.004), n_sides=10)
    floor = ring((0.0, 0.45 * a, 0.45 * b), n_sides=10)
    raised = floor + (0, 0, 0.004)
    parts = [hull(np.concatenate([floor, raised]))]
    for k in range(10):
        pair = [k, (k + 1) % 10]
        corners = [array[pair] for array in (rim, inner, floor, raised)]
        parts.append(hull(np.concatenate(corners)))
    rise = rng.uniform(0.0, 0.02)
    path = [[a - 0.004, 0, depth - 0.002], [a + 0.02, 0, depth + 0.4 * rise],
            [a + length, 0, depth + rise]]  # fmt: skip
    size = (rng.uniform(0.009, 0.016), rng.uniform(0.006, 0.009))
    return Shape([*parts, *sweep(np.array(path), size, (0, 1, 0))], WOOD * 1.5)


def make_spatula(rng: np.random.Generator) -> Shape:
    """Turner: a flat blade, sometimes slanted, and a round grip."""
    width, blade = rng.uniform(0.04, 0.065), rng.uniform(0.05, 0.075)
    length, rise = rng.uniform(0.09, 0.13), rng.uniform(0.01, 0.03)
    outline = [(0, -0.35 * width), (0, 0.35 * width), (blade, 0.5 * width),
               (blade, -0.5 * width)]  # fmt: skip
    plate = sheet(outline, 0.005, z=0.0025)
    path = [[0.006, 0, 0.004], [-0.02, 0, rise], [-length, 0, rise + 0.012]]
    size = (rng.uniform(0.014, 0.02), rng.uniform(0.01, 0.014))
    grip = sweep(np.array(path), size, (0, 1, 0), round_section=True)
    return Shape([plate, *grip], PLASTIC)


def make_torch(rng: np.random.Generator) -> Shape:
    """Flashlight: a tube that widens to the lamp."""
    radius, length = rng.uniform(0.012, 0.018), rng.uniform(0.08, 0.13)
    lamp = radius * rng.uniform(1.3, 1.7)
    tube = cylinder(radius, length, (0, 0, length / 2))
    cone = loft([disc(length, radius), disc(length + 0.018, lamp)])
    head = cylinder(lamp, 0.02, (0, 0, length + 0.027))
    return Shape(moved([tube, cone, head], euler=LYING), 1200.0)


def make_pliers(rng: np.random.Generator) -> Shape:
    """Pliers: two crossed bars, jaws nearly closed."""
    grip, spread = rng.uniform(0.075, 0.105), rng.uniform(0.016, 0.028)
    jaw, thickness = rng.uniform(0.03, 0.05), rng.uniform(0.012, 0.018)
    parts = [cylinder(rng.uniform(0.011, 0.015), thickness * 1.2, (0, 0, 0))]
    for side in (-1, 1):
        handle = [
            [0, 0, 0],
            [-0.35 * grip, side * spread, 0],
            [-grip, side * spread, 0],
        ]
        parts += sweep(np.array(handle), (thickness, 0.011), (0, 0, 1))
        nose = [(0, 0.001 * side), (0, 0.012 * side), (jaw, 0.004 * side),
                (jaw, 0.001 * side)]  # fmt: skip
        parts.append(sheet(nose, thickness))
    return Shape(parts, 2200.0)


def make_drill(rng: np.random.Generator) -> Shape:
    """Toy drill or hair dryer: a barrel with a pistol grip, lying on its side."""
    barrel, radius = rng.uniform(0.07, 0.11), rng.uniform(0.017, 0.024)
    body = cylinder(radius, barrel, (0, 0, 0), "x")
    nose = moved([loft([disc(0, 0.9 * radius), disc(0.025, 0.009)])],
                 (barrel / 2, 0, 0), LYING)  # fmt: skip
    lean, grip = rng.uniform(-0.02, 0.005), rng.uniform(0.055, 0.08)
    path = [
        [-0.25 * barrel, -0.5 * radius, 0],
        [-0.25 * barrel + lean, -radius - grip, 0],
    ]
    handle = sweep(np.array(path), (rng.uniform(0.022, 0.028), 0.026), (0, 0, 1))
    parts = [body, *nose, *handle]
    if rng.random() < 0.6:
        x, y = path[1][:2]
        parts.append(box((0.045, 0.018, 0.032), (x, y, 0)))
    return Shape(parts, 600.0)


def make_roller(rng: np.random.Generator) -> Shape:
    """Rolling pin: a thick cylinder with a knob at either end."""
    radius, length = rng.uniform(0.016, 0.026), rng.uniform(0.08, 0.13)
    parts = [cylinder(radius, length, (0, 0, 0), "x")]
    for side in (-1, 1):
        x = side * length / 2
        parts.append(rod((x, 0, 0), (x + side * 0.03, 0, 0), 0.45 * radius))
    return Shape(parts, WOOD)


def make_clothes_peg(rng: np.random.Generator) -> Shape:
    """Tongs or peg: two long bars that meet at one end."""
    length, gap = rng.uniform(0.08, 0.16), rng.uniform(0.012, 0.03)
    width, thickness = rng.uniform(0.01, 0.018), rng.uniform(0.006, 0.009)
    parts = [cylinder(thickness, width, (0, 0, 0))]
    for side in (-1, 1):
        path = [[0, 0, 0], [0.5 * length, side * gap, 0], [length, side * 0.3 * gap, 0]]
        parts += sweep(np.array(path), (width, thickness), (0, 0, 1))
    return Shape(parts, WOOD * 1.5)


def make_whisk(rng: np.random.Generator) -> Shape:
    """Whisk or maraca: a round head on a stick."""
    radius, length = rng.uniform(0.02, 0.032), rng.uniform(0.08, 0.12)
    stretch = rng.uniform(1.0, 1.5)
    head = ellipsoid((stretch * radius, radius, radius))
    x = stretch * radius
    stick = rod((0.8 * x, 0, 0), (x + length, 0, 0), rng.uniform(0.007, 0.011))
    return Shape([head, stick], WOOD)
