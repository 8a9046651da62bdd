# SPDX-License-Identifier: Apache-2.0
"""Earphones and hats with labelled parts.

Labels of earphones: ``headband`` (also a neckband), ``cup`` (what covers the ear),
``stem`` to hold an in-ear plug by, ``plug`` that goes into the ear, ``cable``. Labels
of hats: ``crown``, ``brim`` (also a visor), ``edge`` (the opening), ``bobble``. Hats
are about half the real size and headphones about 0.8 of it, to fit the workspace.
"""

from collections.abc import Callable

import numpy as np

from sim_bridge.objects.model import Part, part_mesh
from sim_bridge.objects.shapes.assembly import Shape
from sim_bridge.objects.shapes.building import (
    arc_path,
    box,
    disc,
    ellipsoid,
    hull,
    loft,
    mirrored,
    moved,
    rod,
    sheet,
    sphere,
    sweep,
    wall,
)

PLASTIC = 700.0  # densities in [kg/m^3]
FELT = 350.0
HEADBAND, CUP, STEM, PLUG, CABLE = "headband", "cup", "stem", "plug", "cable"
CROWN, BRIM, EDGE, BOBBLE = "crown", "brim", "edge", "bobble"
TO_SIDE = (0.0, np.pi / 2, 0.0)  # turns z to x
TO_EAR = (0.0, -np.pi / 2, 0.0)  # turns z to -x


def _headset(
    rng: np.random.Generator, half_span: float, band: tuple[float, float],
    ear: tuple[float, float, float], squareness: float = 2.0,
) -> list[Part]:  # fmt: skip
    """Return a headband with two cups: ear = half depth, half height, thickness."""
    rise = half_span * rng.uniform(0.95, 1.15)
    arc = arc_path((0, 0, 0), (half_span, rise), (0, np.pi), 12)
    drop = rng.uniform(0.012, 0.03)
    ends = [[side * half_span, 0, -drop] for side in (1, -1)]
    path = np.concatenate([ends[:1], arc, ends[1:]])
    depth, height, thickness = ear
    shell = loft(
        [
            (0, height, depth),
            (0.6 * thickness, height, depth),
            (thickness, 0.8 * height, 0.75 * depth),
        ],
        CUP,
        squareness,
    )
    pad = [(0, 0.85 * height, 0.85 * depth), (-0.008, 0.95 * height, 0.95 * depth)]
    at = (half_span - 0.35 * thickness, 0, -drop - 0.6 * height)
    right = moved([shell, loft(pad, CUP)], at, TO_SIDE)
    return [*sweep(path, band, (0, 1, 0), HEADBAND), *right, *mirrored(right)]


def make_over_ear(rng: np.random.Generator) -> Shape:
    """Large oval cups on a wide, padded headband."""
    ear = (
        rng.uniform(0.026, 0.032),
        rng.uniform(0.032, 0.039),
        rng.uniform(0.022, 0.03),
    )
    band = (rng.uniform(0.02, 0.03), rng.uniform(0.008, 0.012))
    return Shape(_headset(rng, rng.uniform(0.062, 0.074), band, ear), PLASTIC)


def make_on_ear(rng: np.random.Generator) -> Shape:
    """Small round cups on a thin wire."""
    radius = rng.uniform(0.019, 0.025)
    ear = (radius, radius, rng.uniform(0.014, 0.02))
    band = (rng.uniform(0.008, 0.012), rng.uniform(0.006, 0.008))
    return Shape(_headset(rng, rng.uniform(0.058, 0.07), band, ear), PLASTIC)


def _bud(rng: np.random.Generator, stem: float) -> list[Part]:
    """Return an in-ear plug pointing to -x, its stem hanging along -z."""
    head, radius = rng.uniform(0.008, 0.0105), rng.uniform(0.0045, 0.006)
    cone = loft([disc(0, 0.0045), disc(0.012, 0.0075)], PLUG)
    pad = moved([cone], (-head + 0.003, 0, 0), TO_EAR)
    ball = ellipsoid((head, head, head * 1.1), (0, 0, 0), PLUG)
    return [ball, *pad, rod((0.003, 0, 0), (0.003, 0, -stem), radius, STEM)]


def make_in_ear(rng: np.random.Generator) -> Shape:
    """A pair of plugs with long stems on a stiff cable that joins them."""
    stem, half = rng.uniform(0.024, 0.034), rng.uniform(0.028, 0.04)
    right = moved(_bud(rng, stem), (half, 0, 0))
    drop = rng.uniform(0.07, 0.1)
    arc = arc_path((0, 0, -stem), (half + 0.003, drop), (0, -np.pi), 10)
    cable = [rod(arc[k], arc[k + 1], 0.003, CABLE) for k in range(len(arc) - 1)]
    return Shape(
        moved([*right, *mirrored(right), *cable], euler=(np.pi / 2, 0, 0)), PLASTIC
    )


def make_single_bud(rng: np.random.Generator) -> Shape:
    """One large wireless plug with a flat stem, twice its real size."""
    stem, width = rng.uniform(0.045, 0.06), rng.uniform(0.012, 0.017)
    head = rng.uniform(0.016, 0.021)
    ball = ellipsoid((head, 0.85 * head, head), (0, 0, 0), PLUG)
    cone = loft([disc(0, 0.008), disc(0.02, 0.013)], PLUG)
    pad = moved([cone], (-head + 0.006, 0, 0), TO_EAR)
    bar = sweep(np.array([[0.006, 0, 0], [0.006, 0, -stem]]), (width, 0.014), (0, 1, 0),
                STEM)  # fmt: skip
    return Shape(moved([ball, *pad, *bar], euler=(np.pi / 2, 0, 0)), PLASTIC)


def make_neckband(rng: np.random.Generator) -> Shape:
    """A horseshoe for the neck, plugs on short cables at its ends, lying flat."""
    radius, width = rng.uniform(0.058, 0.07), rng.uniform(0.011, 0.015)
    arc = arc_path((0, 0, 0), (radius, 1.1 * radius), (-0.25, np.pi + 0.25), 12, "xy")
    band = sweep(arc, (rng.uniform(0.012, 0.017), width), (0, 0, 1), HEADBAND)
    end = arc[0]
    tip = end + np.array([-0.012, -0.03, 0])
    cable = rod(end, tip, 0.003, CABLE)
    bud = moved(_bud(rng, 0.012), (tip[0], tip[1], tip[2]), (np.pi / 2, 0, 0))
    return Shape([*band, cable, *bud, *mirrored([cable, *bud])], PLASTIC)


def make_ear_hook(rng: np.random.Generator) -> Shape:
    """Sports earphones: flat bodies with hooks, joined by a band behind the head."""
    half = rng.uniform(0.05, 0.062)
    hook_radius = rng.uniform(0.02, 0.026)
    body = box((0.014, 0.022, 0.032), (half, 0, 0), PLUG)
    tip = rod((half, 0, 0), (half - 0.016, 0, 0), 0.006, PLUG)
    y = hook_radius - 0.006  # the hook starts inside the body and ends behind the ear
    arc = arc_path((half, y, 0.012), (hook_radius, hook_radius), (0, np.pi), 6, "yz")
    hook = sweep(arc, (0.007, 0.007), (1, 0, 0), STEM)
    side = [body, tip, *hook]
    reach = (half, rng.uniform(0.035, 0.05))
    back = arc_path((0, y + hook_radius, 0.012), reach, (0, np.pi), 10, "xy")
    band = sweep(back, (rng.uniform(0.01, 0.014), 0.007), (0, 0, 1), HEADBAND)
    return Shape([*side, *mirrored(side), *band], PLASTIC)


def make_headset(rng: np.random.Generator) -> Shape:
    """Large square cups on a double headband, with a microphone on an arm."""
    ear = (
        rng.uniform(0.027, 0.032),
        rng.uniform(0.03, 0.036),
        rng.uniform(0.02, 0.026),
    )
    half = rng.uniform(0.062, 0.072)
    parts = _headset(rng, half, (rng.uniform(0.012, 0.016), 0.009), ear)
    pad_arc = arc_path((0, 0, -0.004), (0.8 * half, 0.8 * half), (0.5, np.pi - 0.5), 6)
    pad = sweep(pad_arc, (0.026, 0.007), (0, 1, 0), HEADBAND)
    ties = [
        rod(pad_arc[k], pad_arc[k] * (1.2, 1, 1.35), 0.0035, HEADBAND) for k in (0, -1)
    ]
    front, z = -ear[0] + 0.004, -ear[1] - 0.012
    arm = np.array([[half, front, z], [half - 0.004, front - 0.022, z - 0.014],
                    [half - 0.02, front - 0.042, z - 0.02]])  # fmt: skip
    boom = [rod(arm[k], arm[k + 1], 0.0035, CABLE) for k in range(len(arm) - 1)]
    return Shape([*parts, *pad, *ties, *boom, sphere(0.008, arm[-1], CABLE)], PLASTIC)


def _joined_buds(rng: np.random.Generator) -> list[Part]:
    """Return two plugs that a stiff cable joins, perhaps with a control on it."""
    stem, half = rng.uniform(0.01, 0.034), rng.uniform(0.024, 0.05)
    right = moved(_bud(rng, stem), (half, 0, 0))
    arc = arc_path((0, 0, -stem), (half + 0.003, rng.uniform(0.04, 0.11)), (0, -np.pi),
                   10)  # fmt: skip
    radius = rng.uniform(0.0028, 0.004)
    cable = [rod(arc[k], arc[k + 1], radius, CABLE) for k in range(len(arc) - 1)]
    if rng.random() < 0.4:
        cable.append(box((0.012, 0.01, 0.03), arc[2].tolist(), CABLE))
    return [*right, *mirrored(right), *cable]


def make_mixed_earphone(rng: np.random.Generator) -> Shape:
    """Any cups on any headband, joined plugs, or one large plug."""
    kind = rng.choice(3, p=(0.55, 0.25, 0.2))
    if kind == 1:
        return Shape(moved(_joined_buds(rng), euler=(np.pi / 2, 0, 0)), PLASTIC)
    if kind == 2:
        head, stem = rng.uniform(0.014, 0.022), rng.uniform(0.035, 0.065)
        ball = ellipsoid((head, rng.uniform(0.8, 1.0) * head, head), (0, 0, 0), PLUG)
        cone = loft([disc(0, 0.4 * head), disc(head, 0.65 * head)], PLUG)
        pad = moved([cone], (-head + 0.006, 0, 0), TO_EAR)
        x, radius = rng.uniform(0, 0.5) * head, rng.uniform(0.006, 0.009)
        bar = rod((x, 0, 0), (x + rng.uniform(-0.01, 0.01), 0, -stem), radius, STEM)
        return Shape(moved([ball, *pad, bar], euler=(np.pi / 2, 0, 0)), PLASTIC)
    ear = (
        rng.uniform(0.017, 0.033),
        rng.uniform(0.019, 0.04),
        rng.uniform(0.013, 0.03),
    )
    band = (rng.uniform(0.008, 0.032), rng.uniform(0.006, 0.012))
    squareness = rng.choice([2.0, 3.0, 6.0])
    parts = _headset(rng, rng.uniform(0.054, 0.075), band, ear, squareness)
    if rng.random() < 0.2:
        foot = part_mesh(parts[-1]).bounds().mean(axis=0)
        end = foot + (rng.uniform(-0.02, 0.0), rng.uniform(-0.02, 0.02), -0.055)
        parts.append(rod(foot, end, 0.0035, CABLE))
    return Shape(parts, PLASTIC)


def _hollow_crown(
    foot: float, top: float, height: float, thickness: float, depth: float = 1.0
) -> list[Part]:
    """Return an upside-down cup: a closed top, a wall, and its lower edge."""
    seam = min(0.014, 0.3 * height)
    radii = np.interp([0, seam, height], [0, height], [foot, top])
    outer = [(z, x, depth * x) for z, x in zip((0, seam, height), radii, strict=True)]
    inner = [(z, x - thickness, y - thickness) for z, x, y in outer]
    cover = loft([(height - 0.004, top, depth * top), (height + 0.003, 0.93 * top,
                  0.93 * depth * top)], CROWN)  # fmt: skip
    edge = wall(inner[:2], outer[:2], EDGE, n_wedges=10)
    return [*edge, *wall(inner[1:], outer[1:], CROWN, n_wedges=10), cover]


def _flat_brim(
    inner: float, outer: float, rise: float, depth: float = 1.0
) -> list[Part]:
    """Return a ring of wedges, ``rise`` higher at its outside."""
    low = [(0.0, inner, depth * inner), (0.006, inner, depth * inner)]
    high = [(rise, outer, depth * outer), (rise + 0.005, outer, depth * outer)]
    return wall(low, high, BRIM, n_wedges=10)


def _visor(radius: float, reach: float, tilt: float) -> list[Part]:
    """Return a visor in front of a crown's foot, and what ties it to the crown."""
    spread = 0.8 * radius
    front = [(spread, 0.5 * radius), (0.75 * spread, radius + 0.75 * reach),
             (0.25 * spread, radius + reach)]  # fmt: skip
    outline = [*front, *[(-x, y) for x, y in reversed(front)]]
    visor = moved([sheet(outline, 0.006, BRIM)], (0, -0.003, 0.005), (tilt, 0, 0))
    clipped = loft([(0.003, spread, 0.02), (0.009, spread, 0.02)], BRIM, 8.0)
    return [*visor, *moved([clipped], (0, 0.85 * radius, 0))]


def make_fedora(rng: np.random.Generator) -> Shape:
    """Oval felt hat: a crown with a pinched top and a middling brim."""
    foot, height = rng.uniform(0.045, 0.055), rng.uniform(0.048, 0.06)
    depth = 0.82
    brim = _flat_brim(foot - 0.004, foot + rng.uniform(0.026, 0.036), 0.008, depth)
    base = _hollow_crown(foot, 0.86 * foot, 0.6 * height, 0.005, depth)
    top = loft([(0.58 * height, 0.86 * foot, 0.86 * depth * foot),
                (height, 0.72 * foot, rng.uniform(0.012, 0.018))], CROWN)  # fmt: skip
    return Shape([*brim, *base, top], FELT)


def make_sun_hat(rng: np.random.Generator) -> Shape:
    """Round crown on a wide, drooping brim."""
    foot, height = rng.uniform(0.038, 0.046), rng.uniform(0.036, 0.048)
    droop = -rng.uniform(0.004, 0.012)
    brim = _flat_brim(foot - 0.004, foot + rng.uniform(0.042, 0.052), droop)
    crown = _hollow_crown(foot, 0.85 * foot, height, 0.005)
    return Shape([*brim, *crown], FELT)


def make_cap(rng: np.random.Generator) -> Shape:
    """Baseball cap: a dome, a visor in front, a button on top."""
    radius = rng.uniform(0.05, 0.06)
    height = radius * rng.uniform(0.75, 0.9)
    low = _hollow_crown(radius, 0.9 * radius, 0.45 * height, 0.005)[:-1]
    dome = loft([disc(0.42 * height, 0.91 * radius), disc(0.75 * height, 0.68 * radius),
                 disc(0.95 * height, 0.35 * radius), disc(height, 0.1 * radius)],
                CROWN)  # fmt: skip
    visor = _visor(radius, rng.uniform(0.042, 0.055), rng.uniform(-0.15, 0.05))
    button = sphere(0.005, (0, 0, height), CROWN)
    return Shape([*low, dome, *visor, button], FELT)


def make_bucket_hat(rng: np.random.Generator) -> Shape:
    """Sloping brim under a straight crown."""
    foot, height = rng.uniform(0.042, 0.05), rng.uniform(0.042, 0.052)
    drop = rng.uniform(0.018, 0.026)
    brim = _flat_brim(foot - 0.004, foot + rng.uniform(0.018, 0.026), -drop)
    return Shape([*brim, *_hollow_crown(foot, 0.88 * foot, height, 0.005)], FELT)


def make_beanie(rng: np.random.Generator) -> Shape:
    """Knitted dome with a thick cuff and a bobble."""
    radius = rng.uniform(0.044, 0.053)
    height = radius * rng.uniform(1.0, 1.25)
    cuff = wall([disc(0, radius - 0.008), disc(0.024, radius - 0.008)],
                [disc(0, radius + 0.002), disc(0.024, radius)], EDGE,
                n_wedges=10)  # fmt: skip
    dome = loft([disc(0.02, 0.95 * radius), disc(0.55 * height, 0.85 * radius),
                 disc(0.85 * height, 0.5 * radius), disc(height, 0.12 * radius)],
                CROWN)  # fmt: skip
    bobble = sphere(rng.uniform(0.015, 0.02), (0, 0, height + 0.01), BOBBLE)
    return Shape([*cuff, dome, bobble], FELT)


def make_top_hat(rng: np.random.Generator) -> Shape:
    """Tall straight crown on a narrow brim."""
    radius, height = rng.uniform(0.031, 0.038), rng.uniform(0.06, 0.08)
    brim = _flat_brim(radius - 0.004, radius + rng.uniform(0.02, 0.028), 0.006)
    crown = _hollow_crown(radius, radius * rng.uniform(0.95, 1.06), height, 0.005)
    return Shape([*brim, *crown], FELT)


def make_cowboy_hat(rng: np.random.Generator) -> Shape:
    """Oval brim curled up at the sides, a high crown that narrows to a crest."""
    x, y = rng.uniform(0.036, 0.042), rng.uniform(0.046, 0.054)
    height = rng.uniform(0.052, 0.064)
    reach, curl = rng.uniform(0.028, 0.036), rng.uniform(0.02, 0.032)
    angles = np.linspace(0, 2 * np.pi, 15)
    inner = np.stack(
        [(x - 0.004) * np.cos(angles), (y - 0.004) * np.sin(angles)], axis=1
    )
    outer = np.stack(
        [(x + reach) * np.cos(angles), (y + reach) * np.sin(angles)], axis=1
    )
    lift = curl * np.cos(angles) ** 2
    brim = []
    for k in range(len(angles) - 1):
        pair = [k, k + 1]
        edge = [np.column_stack([outer[pair], lift[pair] + h]) for h in (0, 0.005)]
        root = [np.column_stack([inner[pair], [h, h]]) for h in (0.0, 0.006)]
        brim.append(hull(np.concatenate(edge + root), BRIM))
    base = _hollow_crown(x, 0.92 * x, 0.6 * height, 0.005, y / x)
    top = loft([(0.58 * height, 0.92 * x, 0.92 * y), (height, 0.013, 0.8 * y)], CROWN)
    return Shape([*brim, *base, top], FELT)


def make_mixed_hat(rng: np.random.Generator) -> Shape:
    """Any crown, flat or domed, with a brim, a visor or a cuff."""
    foot, height = rng.uniform(0.032, 0.056), rng.uniform(0.032, 0.066)
    top = foot * rng.uniform(0.65, 1.05)
    depth = rng.uniform(0.78, 1.0) if rng.random() < 0.5 else 1.0
    parts = _hollow_crown(foot, top, height, 0.005, depth)
    shape = rng.choice(3)
    if shape > 0:  # a dome, or a crown with a ridge
        rise = min(rng.uniform(0.2, 0.6) * foot, 0.08 - height)
        sections = [(height - 0.004, top, depth * top)]
        if shape == 1:
            shoulder = (height + 0.6 * rise, 0.8 * top, 0.8 * depth * top)
            sections += [shoulder, disc(height + rise, 0.3 * top)]
        else:
            sections.append((height + rise, 0.7 * top, 0.014))
        parts[-1] = loft(sections, CROWN)
        height += rise
    kind = rng.choice(3, p=(0.6, 0.2, 0.2))
    if kind == 0:
        reach = min(rng.uniform(0.012, 0.05), 0.095 - foot)
        rise = rng.uniform(-0.35, 0.6) * min(reach, 0.035)
        parts += _flat_brim(foot - 0.004, foot + reach, rise, depth)
    elif kind == 1:
        parts += _visor(foot, rng.uniform(0.03, 0.055), rng.uniform(-0.15, 0.1))
    else:
        cuff = rng.uniform(0.012, 0.028)
        inner = [(z, foot - 0.006, depth * foot - 0.006) for z in (0.0, cuff)]
        outer = [(z, foot + 0.003, depth * foot + 0.003) for z in (0.0, cuff)]
        parts += wall(inner, outer, EDGE, n_wedges=10)
    if rng.random() < 0.15:
        size = rng.uniform(0.012, 0.02)
        parts.append(sphere(size, (0, 0, height + 0.4 * size), BOBBLE))
    return Shape(parts, FELT)


EARPHONES: dict[str, Callable[[np.random.Generator], Shape]] = {
    "over_ear": make_over_ear,
    "on_ear": make_on_ear,
    "in_ear": make_in_ear,
    "single_bud": make_single_bud,
    "neckband": make_neckband,
    "ear_hook": make_ear_hook,
    "headset": make_headset,
}

HATS: dict[str, Callable[[np.random.Generator], Shape]] = {
    "fedora": make_fedora,
    "sun": make_sun_hat,
    "cap": make_cap,
    "bucket": make_bucket_hat,
    "beanie": make_beanie,
    "top_hat": make_top_hat,
    "cowboy": make_cowboy_hat,
}
