# SPDX-License-Identifier: Apache-2.0
"""Boxes, blocks, fruit, toys and other things without a cavity or a handle."""

import numpy as np

from sim_bridge.objects.shapes.assembly import Shape
from sim_bridge.objects.shapes.building import (
    arc_path,
    box,
    cylinder,
    disc,
    ellipsoid,
    loft,
    moved,
    rod,
    sheet,
    sphere,
    sweep,
)

CARDBOARD = 300.0  # densities in [kg/m^3]
WOOD = 650.0
FRUIT = 800.0
PLASTIC = 450.0


def make_box(rng: np.random.Generator) -> Shape:
    """Packet: from a matchbox to a tea carton, standing."""
    x, y = rng.uniform(0.02, 0.068), rng.uniform(0.03, 0.085)
    return Shape([box((x, y, rng.uniform(0.04, 0.15)))], CARDBOARD)


def make_flat_box(rng: np.random.Generator) -> Shape:
    """Book, phone, bar of chocolate: lying flat."""
    size = (
        rng.uniform(0.07, 0.15),
        rng.uniform(0.045, 0.095),
        rng.uniform(0.012, 0.035),
    )
    return Shape([box(size)], WOOD)


def make_soap(rng: np.random.Generator) -> Shape:
    """Soap, sponge or tin with rounded corners."""
    x, y = rng.uniform(0.03, 0.05), rng.uniform(0.02, 0.034)
    height = rng.uniform(0.018, 0.045)
    edge = min(0.008, 0.3 * height)
    sections = [(0, x - edge, y - edge), (edge, x, y), (height - edge, x, y),
                (height, x - edge, y - edge)]  # fmt: skip
    return Shape([loft(sections, "", rng.uniform(2.5, 6.0))], WOOD)


def make_l_block(rng: np.random.Generator) -> Shape:
    """L or T of two bars, lying."""
    width, height = rng.uniform(0.018, 0.035, size=2)
    a, b = rng.uniform(0.07, 0.14), rng.uniform(0.05, 0.1)
    at = rng.choice([0.5, 0.5, rng.uniform(0.0, 0.4)]) * (a - width)
    bar = box((a, width, height))
    return Shape([bar, box((width, b, height), (at, (b + width) / 2, 0))], WOOD)


def make_u_block(rng: np.random.Generator) -> Shape:
    """U or arch of three bars, standing or lying."""
    width, depth = rng.uniform(0.016, 0.028), rng.uniform(0.022, 0.04)
    span, leg = rng.uniform(0.06, 0.12), rng.uniform(0.03, 0.07)
    x, z = (span - width) / 2, -(leg + width) / 2
    legs = [box((width, depth, leg), (side * x, 0, z)) for side in (-1, 1)]
    return Shape([box((span, depth, width)), *legs], WOOD)


def make_cross(rng: np.random.Generator) -> Shape:
    """Cross or Z of three bars at right angles."""
    width = rng.uniform(0.016, 0.03)
    a, b, c = rng.uniform(0.06, 0.13), rng.uniform(0.05, 0.11), rng.uniform(0.03, 0.06)
    x, y = rng.uniform(-0.3, 0.3, size=2) * (a, b)
    parts = [box((a, width, width)), box((width, b, width), (x, y, 0))]
    if rng.random() < 0.5:
        parts.append(box((width, width, c), (x, 0, (c + width) / 2)))
    return Shape(parts, WOOD)


def make_wedge(rng: np.random.Generator) -> Shape:
    """Prism, ramp, cone or pyramid of a toy box."""
    x, y = rng.uniform(0.018, 0.035), rng.uniform(0.018, 0.045)
    height, top = rng.uniform(0.03, 0.08), rng.uniform(0.02, 0.6)
    squareness = rng.choice([2.0, 14.0])
    return Shape([loft([(0, x, y), (height, top * x, y * top)], "", squareness)], WOOD)


def make_polygon_block(rng: np.random.Generator) -> Shape:
    """Prism over a regular polygon: nuts, pencils' boxes, hexagonal tins."""
    n, radius = int(rng.integers(3, 9)), rng.uniform(0.02, 0.038)
    angles = np.arange(n) * (2 * np.pi / n)
    outline = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return Shape([sheet(outline, rng.uniform(0.025, 0.11))], PLASTIC)


def make_fruit(rng: np.random.Generator) -> Shape:
    """Ball, apple, lemon or egg, sometimes with a stalk."""
    radius = rng.uniform(0.02, 0.037)
    stretch = rng.uniform(0.85, 1.4)
    parts = [ellipsoid((radius, radius, radius * stretch))]
    if 0.98 < stretch < 1.06:
        parts = [sphere(radius, (0, 0, 0))]
    if rng.random() < 0.4:
        top = radius * stretch
        parts.append(rod((0, 0, top - 0.003), (0.003, 0, top + 0.01), 0.0025))
    return Shape(parts, FRUIT)


def make_pear(rng: np.random.Generator) -> Shape:
    """Pear, light bulb or skittle: a big ball under a small one."""
    low, high = rng.uniform(0.024, 0.036), rng.uniform(0.01, 0.019)
    z = low + rng.uniform(0.008, 0.035)
    waist = loft([disc(0.3 * low, 0.93 * low), disc(z, high)])
    return Shape([sphere(low, (0, 0, 0)), waist, sphere(high, (0, 0, z))], FRUIT)


def make_banana(rng: np.random.Generator) -> Shape:
    """Banana, croissant or boomerang: a curved bar, thin at the ends."""
    bend, reach = rng.uniform(0.5, 1.0), rng.uniform(0.06, 0.1)
    thickness, n = rng.uniform(0.011, 0.018), 6
    path = arc_path((0, 0, 0), (reach, reach), (-bend, bend), n, "xy")
    radii = thickness * (0.55 + 0.45 * np.sin(np.linspace(0.3, np.pi - 0.3, n)))
    parts = [rod(path[k], path[k + 1], radii[k]) for k in range(n)]
    return Shape(parts, FRUIT)


def make_tape_roll(rng: np.random.Generator) -> Shape:
    """Roll of tape, bracelet or doughnut: a ring."""
    radius, thickness = rng.uniform(0.028, 0.045), rng.uniform(0.009, 0.018)
    path = arc_path((0, 0, 0), (radius, radius), (0, 2 * np.pi), 12, "xy")
    size = (rng.uniform(0.016, 0.045), thickness)
    is_round = bool(rng.random() < 0.4)
    size = (thickness, thickness) if is_round else size
    return Shape(sweep(path, size, (0, 0, 1), round_section=is_round), PLASTIC)


def make_dumbbell(rng: np.random.Generator) -> Shape:
    """Dumbbell, spool or bone: two heads on a bar."""
    radius, length = rng.uniform(0.017, 0.03), rng.uniform(0.05, 0.09)
    width = rng.uniform(0.015, 0.035)
    parts = [cylinder(rng.uniform(0.007, 0.012), length, (0, 0, 0), "x")]
    kind = rng.integers(3)
    for side in (-1, 1):
        at = (side * (length + width) / 2, 0, 0)
        if kind == 0:
            parts.append(cylinder(radius, width, at, "x"))
        elif kind == 1:
            parts.append(sphere(radius, at))
        else:
            parts.append(box((width, 1.7 * radius, 1.7 * radius), at))
    return Shape(parts, 1000.0)


def make_figurine(rng: np.random.Generator) -> Shape:
    """Standing figure: body, head, arms and feet."""
    body, head = rng.uniform(0.015, 0.024), rng.uniform(0.012, 0.02)
    height = rng.uniform(0.03, 0.055)
    z = height + 0.5 * body
    parts = [loft([(0, body, 0.8 * body), (height, 0.7 * body, 0.6 * body)])]
    parts.append(sphere(head, (0, 0, height + 0.8 * head)))
    lift = rng.uniform(-0.02, 0.02)
    for side in (-1, 1):
        shoulder = (side * 0.55 * body, 0, 0.85 * height)
        hand = (side * (body + 0.02), 0.004, 0.7 * height + lift)
        parts.append(rod(shoulder, hand, rng.uniform(0.005, 0.008)))
        foot = (0.018, 0.03, 0.014)
        parts.append(box(foot, (side * 0.5 * body, 0.006, -0.004)))
    if rng.random() < 0.4:
        parts.append(loft([disc(z + head, head), disc(z + head + 0.025, 0.003)]))
    return Shape(parts, WOOD)


def make_animal(rng: np.random.Generator) -> Shape:
    """Four-legged toy: body, legs, neck and head."""
    length, radius = rng.uniform(0.05, 0.08), rng.uniform(0.014, 0.022)
    leg = rng.uniform(0.018, 0.035)
    parts = [rod((-length / 2, 0, 0), (length / 2, 0, 0), radius)]
    for x in (-0.42, 0.42):
        for y in (-0.6, 0.6):
            at = (x * length, y * radius)
            end = (*at, -radius - leg)
            parts.append(rod((*at, -0.3 * radius), end, rng.uniform(0.005, 0.008)))
    neck = (length / 2 + rng.uniform(0.0, 0.015), 0, radius + rng.uniform(0.008, 0.035))
    parts.append(rod((length / 2, 0, 0), neck, 0.55 * radius))
    snout = (neck[0] + 0.02, 0, neck[2] - 0.004)
    parts.append(rod(neck, snout, rng.uniform(0.008, 0.012)))
    return Shape(parts, PLASTIC)


def make_camera(rng: np.random.Generator) -> Shape:
    """Camera: a box with a lens and a viewfinder."""
    x, y, z = (
        rng.uniform(0.07, 0.11),
        rng.uniform(0.024, 0.038),
        rng.uniform(0.045, 0.065),
    )
    lens, reach = 0.42 * z, rng.uniform(0.012, 0.035)
    parts = [box((x, y, z)), cylinder(lens, reach, (0, -(y + reach) / 2, 0), "y")]
    if rng.random() < 0.7:
        parts.append(box((0.03, 0.8 * y, 0.014), (rng.uniform(-0.02, 0.02), 0, z / 2)))
    return Shape(parts, 600.0)


def make_stapler(rng: np.random.Generator) -> Shape:
    """Stapler: a base and an arm that meet at the hinge."""
    length, width = rng.uniform(0.09, 0.14), rng.uniform(0.024, 0.036)
    opening = rng.uniform(0.012, 0.025)
    base = box((length, width, 0.012), (0, 0, 0.006))
    half = length / 2
    path = [[-half, 0, 0.02], [-0.2 * length, 0, 0.026], [half, 0, 0.02 + opening]]
    arm = sweep(np.array(path), (0.8 * width, rng.uniform(0.014, 0.022)), (0, 1, 0))
    return Shape([base, *arm], 900.0)


def make_car(rng: np.random.Generator) -> Shape:
    """Toy car: body, cabin and four wheels."""
    length, width = rng.uniform(0.07, 0.12), rng.uniform(0.032, 0.048)
    height, wheel = rng.uniform(0.014, 0.024), rng.uniform(0.009, 0.015)
    cabin = loft([(0, 0.3 * length, 0.46 * width), (0.022, 0.2 * length, 0.38 * width)],
                 "", 8.0)  # fmt: skip
    z = wheel + height / 2
    body = box((length, width, height), (0, 0, z))
    wheels = [
        cylinder(wheel, 0.01, (x * length, y * width, wheel), "y")
        for x in (-0.32, 0.32)
        for y in (-0.5, 0.5)
    ]
    roof = moved([cabin], (-0.05 * length, 0, z + height / 2))
    return Shape([body, *roof, *wheels], PLASTIC)


def make_tower(rng: np.random.Generator) -> Shape:
    """Pile of discs and boxes on one axis: salt mill, chess piece, stacking toy."""
    parts, z = [], 0.0
    half = rng.uniform(0.022, 0.034)
    for _ in range(int(rng.integers(2, 5))):
        height = rng.uniform(0.014, 0.04)
        at = (0, 0, z + height / 2)
        if rng.random() < 0.6:
            parts.append(cylinder(half, height, at))
        else:
            parts.append(box((1.7 * half, 1.7 * half, height), at))
        z += height
        half *= rng.uniform(0.55, 0.95)
    return Shape(parts, PLASTIC)


def make_shoe(rng: np.random.Generator) -> Shape:
    """Child's shoe: a sole, a toe and an open heel."""
    length, width = rng.uniform(0.1, 0.145), rng.uniform(0.04, 0.052)
    height, half = rng.uniform(0.04, 0.055), length / 2
    sole = box((length, width, 0.012), (0, 0, 0.006))
    toe = loft(
        [(0.01, 0.3 * length, 0.5 * width), (0.03, 0.26 * length, 0.45 * width),
         (height, 0.08 * length, 0.3 * width)]
    )  # fmt: skip
    toe = moved([toe], (0.2 * length, 0, 0))[0]
    path = np.array([[0.1 * half, 1, 0], [-half + 0.015, 1, 0], [-half, 0, 0],
                     [-half + 0.015, -1, 0], [0.1 * half, -1, 0]])  # fmt: skip
    path[:, 1] *= width / 2 - 0.004
    path[:, 2] = 0.012 + height / 2
    path[0] = path[0] * (1, 1, 0.8)
    return Shape([sole, toe, *sweep(path, (height, 0.007), (0, 0, 1))], PLASTIC)
