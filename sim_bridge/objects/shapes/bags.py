# SPDX-License-Identifier: Apache-2.0
"""Bags with labelled parts, standing.

Labels: ``body``, ``opening`` (upper edge or gathered top), ``handle`` to hang from a
hand, ``strap`` long enough for a shoulder. They are about half the real size, so that
several fit the 30 cm workspace; handles keep a thickness that a gripper can feel.
"""

from collections.abc import Callable

import numpy as np

from sim_bridge.objects.model import Part, part_mesh
from sim_bridge.objects.shapes.assembly import Shape
from sim_bridge.objects.shapes.building import (
    Section,
    arc_path,
    box,
    cylinder,
    disc,
    loft,
    sweep,
)

STUFFED = 220.0  # density of a filled bag [kg/m^3]
LEATHER = 350.0
BODY, OPENING, HANDLE, STRAP = "body", "opening", "handle", "strap"


def _open_top(x: float, y: float, z: float, rim: float) -> list[Part]:
    """Return four upright walls on the rectangle of half sizes x, y from height z."""
    t, middle = 0.005, z + rim / 2
    long = [
        box((2 * x, t, rim), (0, s * (y - t / 2), middle), OPENING) for s in (-1, 1)
    ]
    short = [
        box((t, 2 * y, rim), (s * (x - t / 2), 0, middle), OPENING) for s in (-1, 1)
    ]
    return [*long, *short]


def _arch(
    half_span: float, rise: float, at: tuple[float, float], size: tuple[float, float],
    label: str = HANDLE,
) -> list[Part]:  # fmt: skip
    """Return an arch in the xz plane over its feet at depth y and height z."""
    y, z = at
    path = arc_path((0, y, z), (half_span, rise), (0, np.pi), 10)
    return sweep(path, size, (0, 1, 0), label)


def make_tote_bag(rng: np.random.Generator) -> Shape:
    """Open bag with a pair of handles."""
    x, y = rng.uniform(0.05, 0.07), rng.uniform(0.022, 0.034)
    height, rim = rng.uniform(0.06, 0.09), rng.uniform(0.02, 0.032)
    sections: list[Section] = [(0, 0.88 * x, 0.9 * y), (height, x, y)]
    span, rise = rng.uniform(0.45, 0.65) * x, rng.uniform(0.045, 0.065)
    size = (rng.uniform(0.007, 0.01), rng.uniform(0.006, 0.008))
    body = loft(sections, BODY, 8.0)
    top = height + rim - 0.004
    lean = y - 0.0045
    handles = [p for s in (-1, 1) for p in _arch(span, rise, (s * lean, top), size)]
    return Shape([body, *_open_top(x, y, height, rim), *handles], STUFFED)


def make_handbag(rng: np.random.Generator) -> Shape:
    """Closed bag that narrows upwards, with one arched handle."""
    x, y = rng.uniform(0.05, 0.068), rng.uniform(0.02, 0.032)
    height = rng.uniform(0.065, 0.09)
    top_x, top_y = 0.8 * x, 0.4 * y
    body = loft(
        [(0, x, y), (0.5 * height, 0.98 * x, y), (height, top_x, top_y)], BODY, 6.0
    )
    clasp = box((1.7 * top_x, 1.6 * top_y, 0.012), (0, 0, height + 0.003), OPENING)
    size = (rng.uniform(0.01, 0.015), rng.uniform(0.008, 0.011))
    rise = rng.uniform(0.042, 0.06)
    return Shape([body, clasp, *_arch(0.7 * top_x, rise, (0, height), size)], LEATHER)


def make_shoulder_bag(rng: np.random.Generator) -> Shape:
    """Flap bag on a long strap that starts at its sides."""
    x, y = rng.uniform(0.045, 0.062), rng.uniform(0.02, 0.03)
    height = rng.uniform(0.05, 0.075)
    body = box((2 * x, 2 * y, height), (0, 0, height / 2), BODY)
    flap = loft(
        [(0.45 * height, x, y + 0.004), (height + 0.006, x, y + 0.004)], BODY, 9.0
    )
    rise = rng.uniform(0.09, 0.12)
    path = arc_path((0, 0, 0.8 * height), (x, rise), (0, np.pi), 12)
    size = (rng.uniform(0.012, 0.02), rng.uniform(0.006, 0.008))
    return Shape([body, flap, *sweep(path, size, (0, 1, 0), STRAP)], LEATHER)


def make_paper_bag(rng: np.random.Generator) -> Shape:
    """Shopping bag: a tall box, an open edge, two cords."""
    x, y = rng.uniform(0.04, 0.055), rng.uniform(0.025, 0.035)
    height, rim = rng.uniform(0.08, 0.105), rng.uniform(0.03, 0.04)
    body = box((2 * x, 2 * y, height), (0, 0, height / 2), BODY)
    top, lean = height + rim - 0.006, y - 0.006
    size = (0.007, 0.007)
    cords = [
        p
        for s in (-1, 1)
        for p in _arch(0.45 * x, rng.uniform(0.036, 0.045), (s * lean, top), size)
    ]
    return Shape([body, *_open_top(x, y, height, rim), *cords], 150.0)  # fmt: skip


def make_backpack(rng: np.random.Generator) -> Shape:
    """Rounded bag with a front pocket, a top loop and two straps on its back."""
    x, y = rng.uniform(0.042, 0.055), rng.uniform(0.022, 0.03)
    height = rng.uniform(0.11, 0.135)
    shoulders = (0.93 * height, 0.75 * x, 0.8 * y)
    top = (height, 0.5 * x, 0.6 * y)
    body = loft([(0, 0.95 * x, y), (0.7 * height, x, y), shoulders, top], BODY, 4.0)
    pocket = box((1.4 * x, 0.018, 0.4 * height), (0, -y - 0.006, 0.27 * height), BODY)
    loop = _arch(0.3 * x, rng.uniform(0.03, 0.038), (0.2 * y, height - 0.004),
                 (0.011, 0.007))  # fmt: skip
    width, out = rng.uniform(0.013, 0.018), rng.uniform(0.026, 0.034)
    straps = []
    for side in (-1, 1):
        path = arc_path((0, y - 0.004, 0.5 * height), (out, 0.38 * height),
                        (np.pi / 2, -np.pi / 2), 8, "yz")  # fmt: skip
        path[:, 0] = side * 0.5 * x
        straps += sweep(path, (width, 0.008), (1, 0, 0), STRAP)
    return Shape([body, pocket, *loop, *straps], STUFFED)


def make_pouch(rng: np.random.Generator) -> Shape:
    """Drawstring pouch: a sack with a gathered, flaring top."""
    radius, height = rng.uniform(0.034, 0.046), rng.uniform(0.06, 0.085)
    neck = rng.uniform(0.011, 0.015)
    sack = loft([disc(0, 0.7 * radius), disc(0.25 * height, radius),
                 disc(0.6 * height, 0.9 * radius), disc(height, neck)],
                BODY)  # fmt: skip
    frill = loft(
        [disc(height - 0.002, neck), disc(height + 0.034, 1.9 * neck)], OPENING
    )
    cord = cylinder(neck + 0.003, 0.008, (0, 0, height), "z", OPENING)
    return Shape([sack, frill, cord], STUFFED)


def make_basket(rng: np.random.Generator) -> Shape:
    """Shopping basket: low, oval, with one wide handle across."""
    x, y = rng.uniform(0.05, 0.065), rng.uniform(0.036, 0.045)
    height, rim = rng.uniform(0.035, 0.05), 0.02
    body = loft([(0, 0.85 * x, 0.85 * y), (height, 0.95 * x, 0.95 * y)], BODY, 8.0)
    path = arc_path((0, 0, height), (x - 0.004, rng.uniform(0.08, 0.1)), (0, np.pi), 10)
    size = (rng.uniform(0.011, 0.017), 0.008)
    handle = sweep(path, size, (0, 1, 0), HANDLE)
    walls = _open_top(0.97 * x, 0.97 * y, height, rim)
    return Shape([body, *walls, *handle], STUFFED)


def make_briefcase(rng: np.random.Generator) -> Shape:
    """Slim hard case with a square handle on its long side."""
    x, y = rng.uniform(0.065, 0.085), rng.uniform(0.016, 0.024)
    height = rng.uniform(0.08, 0.105)
    body = loft([(0, x, y), (height, x, y)], BODY, 12.0)
    span, rise = rng.uniform(0.028, 0.036), rng.uniform(0.026, 0.034)
    path = np.array([[-span, 0, height - 0.003], [-span, 0, height + rise],
                     [span, 0, height + rise], [span, 0, height - 0.003]])  # fmt: skip
    size = (rng.uniform(0.011, 0.015), rng.uniform(0.009, 0.012))
    return Shape([body, *sweep(path, size, (0, 1, 0), HANDLE)], LEATHER)


def _closure(rng: np.random.Generator, x: float, y: float, height: float) -> list[Part]:
    """Return nothing, a clasp, a frill, or open walls on a top of half sizes x, y."""
    kind = rng.choice(4, p=(0.25, 0.25, 0.1, 0.4))
    if kind == 1:
        size = (rng.uniform(1.2, 1.95) * x, rng.uniform(1.0, 1.9) * y, 0.014)
        return [box(size, (0, 0, height + 0.004), OPENING)]
    if kind == 2:
        low, high = rng.uniform(0.5, 0.9), rng.uniform(0.9, 1.2)
        foot = (height - 0.002, low * x, low * y)
        edge = (height + rng.uniform(0.015, 0.035), high * x, high * y)
        return [loft([foot, edge], OPENING, 3.0)]
    return _open_top(x, y, height, rng.uniform(0.014, 0.04)) if kind == 3 else []


def make_mixed_bag(rng: np.random.Generator) -> Shape:
    """Any body and closure, with handles or a strap, or without both."""
    x, y = rng.uniform(0.04, 0.08), rng.uniform(0.017, 0.04)
    height = rng.uniform(0.04, 0.115)
    top_x, top_y = x * rng.uniform(0.6, 1.05), y * rng.uniform(0.5, 1.05)
    swell = rng.uniform(1.0, 1.08)
    middle = (0.45 * height, swell * x, swell * y)
    squareness = rng.choice([2.5, 4.0, 8.0, 12.0])
    body = loft([(0, x, y), middle, (height, top_x, top_y)], BODY, squareness)
    closure = _closure(rng, top_x, top_y, height)
    edge = height
    if closure:
        edge = float(max(part_mesh(part).bounds()[1][2] for part in closure)) - 0.005
    parts = [body, *closure]
    size = (rng.uniform(0.007, 0.018), rng.uniform(0.006, 0.011))
    span, rise = rng.uniform(0.35, 0.75) * top_x, rng.uniform(0.026, 0.065)
    kind = rng.choice(5, p=(0.12, 0.22, 0.22, 0.22, 0.22))
    is_open = len(closure) > 1
    if kind == 1 and not is_open:
        parts += _arch(span, rise, (0, edge), size)
    elif kind == 2 and not is_open:
        corners = [[-span, 0, edge], [-span, 0, edge + rise],
                   [span, 0, edge + rise], [span, 0, edge]]  # fmt: skip
        parts += sweep(np.array(corners), size, (0, 1, 0), HANDLE)
    elif kind in (1, 2, 3):
        lean = top_y - 0.0045 if is_open else rng.uniform(0.4, 0.6) * top_y
        for side in (-1, 1):
            parts += _arch(span, rise, (side * lean, edge), size)
    elif kind == 4:
        foot = rng.uniform(0.6, 0.95) * height
        wide = float(np.interp(foot, [middle[0], height], [middle[1], top_x]))
        path = arc_path((0, 0, foot), (wide, rng.uniform(0.075, 0.12)), (0, np.pi), 12)
        band = (rng.uniform(0.01, 0.02), rng.uniform(0.006, 0.009))
        parts += sweep(path, band, (0, 1, 0), STRAP)
    return Shape(parts, STUFFED if rng.random() < 0.6 else LEATHER)


BAGS: dict[str, Callable[[np.random.Generator], Shape]] = {
    "tote": make_tote_bag,
    "handbag": make_handbag,
    "shoulder": make_shoulder_bag,
    "paper": make_paper_bag,
    "backpack": make_backpack,
    "pouch": make_pouch,
    "basket": make_basket,
    "briefcase": make_briefcase,
}
