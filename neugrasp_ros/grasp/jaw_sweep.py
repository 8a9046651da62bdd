# SPDX-License-Identifier: Apache-2.0
"""How far an oriented hand can advance over a cloud, and what is then between its jaws.

In: oriented hands grouped by the seed point that they belong to, and the cloud.
Out: per hand the sideways shift that centres the jaws, the range of feasible depths,
and for chosen depths what the jaws would touch. One pass over the points near a seed
serves all its hands, and trying depths costs nothing: advancing is a shift along z, so
each point only lowers a limit.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.geometry.grid import run_in_parts

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BIN = 0.002  # [m] resolution of the profile between the jaws
NEIGHBOURS = 32  # grasps in a row that share one look-up of the points around them
N_BINS = 160  # the profile reaches 16 cm to either side of the anchor


class SweepSettings(NamedTuple):
    """Lengths of a sweep, all in [m], and how it is shared out.

    Attributes:
        opening: Distance of the inner pad faces on the way.
        radius: Points further from a hand's seed do not matter.
        probe: A hand centres itself on what its tips would enclose this far in.
        insertion: Least advance of the tips beyond the first thing between them.
        inflation: Added to the sides of the fingers and the palm.
        palm_gap: Distance that the palm keeps from everything.
        gap: Points further apart than this along y are not one thing.
        slack: Hands that lack more than this of the insertion are given up early.
        threads: Worker threads.
    """

    opening: float
    radius: float
    probe: float
    insertion: float
    inflation: float
    palm_gap: float
    gap: float
    slack: float
    threads: int = 1


class DepthRange(NamedTuple):
    """Feasible advance of each oriented hand beyond its anchor.

    Attributes:
        shifts: Move along y that centres the jaws, in [m], shape (F,).
        shallow: Least advance that has enough between the pads, in [m], shape (F,);
            inf = never.
        deep: Furthest advance without touching, in [m], shape (F,).
    """

    shifts: FloatArray
    shallow: FloatArray
    deep: FloatArray


class JawContent(NamedTuple):
    """What stands between the open jaws of each hand.

    Attributes:
        lower: Least y of it in [m], shape (G,); inf = nothing.
        upper: Greatest y of it in [m], shape (G,).
        alignment: Mean cosine between the closing direction and the surface where the
            pads would touch, of the worse pad [-], shape (G,).
        other: The same for the better pad, shape (G,).
    """

    lower: FloatArray
    upper: FloatArray
    alignment: FloatArray
    other: FloatArray


@njit(cache=True, nogil=True)
def _gather(
    points: FloatArray, center: FloatArray, radius: float, rows: IntArray
) -> int:
    n = 0
    for i in range(len(points)):
        dx = points[i, 0] - center[0]
        dy = points[i, 1] - center[1]
        dz = points[i, 2] - center[2]
        if dx * dx + dy * dy + dz * dz < radius * radius:
            rows[n] = i
            n += 1
    return n


@njit(cache=True, nogil=True)
def _to_hand(
    points: FloatArray, hand_pose: FloatArray, half_x: float, local: FloatArray
) -> int:
    """Write |x|, y, z of the points with |x| < half_x; return their number."""
    n = 0
    for i in range(len(points)):
        dx = points[i, 0] - hand_pose[0, 3]
        dy = points[i, 1] - hand_pose[1, 3]
        dz = points[i, 2] - hand_pose[2, 3]
        x = dx * hand_pose[0, 0] + dy * hand_pose[1, 0] + dz * hand_pose[2, 0]
        if abs(x) < half_x:
            local[n, 0] = abs(x)
            for j in range(1, 3):
                local[n, j] = (
                    dx * hand_pose[0, j] + dy * hand_pose[1, j] + dz * hand_pose[2, j]
                )
            n += 1
    return n


@njit(cache=True, nogil=True)
def _run_center(
    local: FloatArray, half_x: float, probe: float, gap: int, filled: BoolArray
) -> float:
    """Return the middle of the unbroken run of points around y = 0, NaN if none."""
    filled[:] = False
    middle = N_BINS // 2
    for i in range(len(local)):
        if local[i, 0] < half_x and local[i, 2] < probe:
            b = int(np.floor(local[i, 1] / BIN)) + middle
            if 0 <= b < N_BINS:
                filled[b] = True
    ends = np.empty(2, dtype=np.int64)
    for side in range(2):
        step = 2 * side - 1
        last = middle - step
        b = middle
        while 0 <= b < N_BINS and (b - last) * step <= gap:
            if filled[b]:
                last = b
            b += step
        ends[side] = last
    if ends[1] < ends[0]:
        return np.nan
    return float((0.5 * (ends[0] + ends[1] + 1) - middle) * BIN)


@njit(cache=True, nogil=True)
def _finger_range(
    local: FloatArray, shift: float, opening: float, hand: FloatArray, inflation: float
) -> tuple[float, float]:
    """Return where the content begins along z and where a finger first touches."""
    half_thickness = hand[0]
    outer = opening / 2 + hand[1] + inflation
    first = np.inf
    touch = np.inf
    for i in range(len(local)):
        y = abs(local[i, 1] - shift)
        z = local[i, 2]
        if y < opening / 2 and local[i, 0] < half_thickness:
            first = min(first, z)
        if opening / 2 - inflation < y < outer:
            touch = min(touch, z - inflation)
    return first, touch


@njit(cache=True, nogil=True)
def _palm_touch(
    points: FloatArray,
    hand_pose: FloatArray,
    shift: float,
    half_x: float,
    half_y: float,
) -> float:
    """Return the least z of the points in front of the palm."""
    touch = np.inf
    for i in range(len(points)):
        dx = points[i, 0] - hand_pose[0, 3]
        dy = points[i, 1] - hand_pose[1, 3]
        dz = points[i, 2] - hand_pose[2, 3]
        z = dx * hand_pose[0, 2] + dy * hand_pose[1, 2] + dz * hand_pose[2, 2]
        if z >= touch:
            continue
        x = dx * hand_pose[0, 0] + dy * hand_pose[1, 0] + dz * hand_pose[2, 0]
        y = dx * hand_pose[0, 1] + dy * hand_pose[1, 1] + dz * hand_pose[2, 1]
        if abs(x) < half_x and abs(y - shift) < half_y:
            touch = z
    return touch


@njit(cache=True, nogil=True)
def _sweep(  # noqa: PLR0913 (a kernel)
    points: FloatArray,
    seeds: FloatArray,
    offsets: IntArray,
    hand_poses: FloatArray,
    centered: BoolArray,
    hand: FloatArray,
    settings: FloatArray,
    found: FloatArray,
) -> None:
    """Write shift, shallow and deep, (F, 3), of the hands of some seeds."""
    opening, radius, probe, insertion, inflation, palm_gap, gap, slack = settings
    rows = np.empty(len(points), dtype=np.int64)
    buffer = np.empty((len(points), 3))
    filled = np.empty(N_BINS, dtype=np.bool_)
    for s in range(len(seeds)):
        near = points[rows[: _gather(points, seeds[s], radius, rows)]]
        for f in range(offsets[s], offsets[s + 1]):
            pose = hand_poses[f]
            local = buffer[: _to_hand(near, pose, hand[0] + inflation, buffer)]
            shift = 0.0
            if not centered[f]:
                shift = _run_center(local, hand[0], probe, int(gap), filled)
            if not abs(shift) < opening / 2:
                continue
            first, touch = _finger_range(local, shift, opening, hand, inflation)
            start = max(first, 0.0) if centered[f] else first
            if touch < start + insertion - slack:
                continue
            palm = _palm_touch(
                near, pose, shift, hand[3] + inflation, hand[4] + inflation
            )
            touch = min(touch, palm + hand[2] - palm_gap)
            found[f] = (shift, start + insertion, touch)


@njit(cache=True, nogil=True)
def _pad_alignment(
    cloud: FloatArray,
    pose: FloatArray,
    content: FloatArray,
    rows: IntArray,
    band: float,
) -> tuple[float, float, float, float]:
    """Return extents along y and the alignment at the -y and at the +y pad."""
    lower = content.min()
    upper = content.max()
    sums = np.zeros(2)
    counts = np.zeros(2)
    for k in range(len(content)):
        i = rows[k]
        facing = 0.0
        for j in range(3):
            facing += cloud[i, 3 + j] * pose[j, 1]
        if content[k] < lower + band and facing < 0:
            sums[0] -= facing
            counts[0] += 1
        if content[k] > upper - band and facing > 0:
            sums[1] += facing
            counts[1] += 1
    return (
        lower,
        upper,
        sums[0] / max(counts[0], 1.0),
        sums[1] / max(counts[1], 1.0),
    )


@njit(cache=True, nogil=True)
def _content(
    cloud: FloatArray,
    pose: FloatArray,
    half_size: FloatArray,
    content: FloatArray,
    rows: IntArray,
) -> int:
    """Write y and row of the points between open jaws; return their number."""
    half_thickness, half_opening, depth = half_size
    n = 0
    for i in range(len(cloud)):
        dx = cloud[i, 0] - pose[0, 3]
        dy = cloud[i, 1] - pose[1, 3]
        dz = cloud[i, 2] - pose[2, 3]
        x = dx * pose[0, 0] + dy * pose[1, 0] + dz * pose[2, 0]
        if abs(x) > half_thickness:
            continue
        z = dx * pose[0, 2] + dy * pose[1, 2] + dz * pose[2, 2]
        y = dx * pose[0, 1] + dy * pose[1, 1] + dz * pose[2, 1]
        if -depth < z < 0.0 and abs(y) < half_opening:
            content[n] = y
            rows[n] = i
            n += 1
    return n


@njit(cache=True, nogil=True)
def _inspect(
    cloud: FloatArray,
    poses: FloatArray,
    group_size: int,
    half_size: FloatArray,
    band: float,
    found: FloatArray,
) -> None:
    """Write extents and alignments, (G, 4)."""
    content = np.empty(len(cloud))
    rows = np.empty(len(cloud), dtype=np.int64)
    for start in range(0, len(poses), group_size):
        group = poses[start : start + group_size]
        center = np.zeros(3)
        for g in range(len(group)):
            center += group[g, :3, 3] / len(group)
        reach = 0.0
        for g in range(len(group)):
            reach = max(reach, np.sqrt(((group[g, :3, 3] - center) ** 2).sum()))
        reach += np.sqrt((half_size * half_size).sum())
        near = cloud[rows[: _gather(cloud, center, reach, rows)]]
        for g in range(len(group)):
            n = _content(near, group[g], half_size, content, rows)
            if n == 0:
                found[start + g, 0] = np.inf
                found[start + g, 1] = -np.inf
            else:
                found[start + g] = _pad_alignment(
                    near, group[g], content[:n], rows[:n], band
                )


def sweep_depths(
    points: FloatArray,
    seeds: FloatArray,
    T_task_hands: FloatArray,
    hands_per_seed: IntArray,
    centered: BoolArray,
    hand: FloatArray,
    settings: SweepSettings,
) -> DepthRange:
    """Advance oriented hands over a cloud until they touch.

    Args:
        points: Surface points in [m], shape (N, 3).
        seeds: Points near which the hands are, in [m], shape (S, 3).
        T_task_hands: Hands at advance 0, those of one seed in a row, shape (F, 4, 4).
        hands_per_seed: How many hands each seed has, shape (S,), adding up to F.
        centered: True for hands that shall keep their y; they also count their
            insertion from the anchor if that is further, shape (F,).
        hand: From ``collision.hand_measures``.
        settings: Lengths and threads.
    """
    lengths = np.array(settings._replace(gap=np.ceil(settings.gap / BIN))[:-1])
    points = np.ascontiguousarray(points, dtype=np.float64)
    seeds = np.ascontiguousarray(seeds, dtype=np.float64)
    poses = np.ascontiguousarray(T_task_hands, dtype=np.float64)
    offsets = np.concatenate([[0], np.cumsum(hands_per_seed)]).astype(np.int64)
    found = np.tile([0.0, np.inf, 0.0], (len(poses), 1))

    def run(part: slice) -> None:
        ends = offsets[part.start : part.stop + 1]
        _sweep(points, seeds[part], ends, poses, centered, hand, lengths, found)

    run_in_parts(run, len(seeds), settings.threads)
    return DepthRange(found[:, 0], found[:, 1], found[:, 2])


def jaw_content(
    cloud: FloatArray,
    T_task_gripper: FloatArray,
    opening: float,
    hand: FloatArray,
    band: float = 0.004,
    threads: int = 1,
) -> JawContent:
    """Look at what stands between the open jaws.

    Args:
        cloud: Points in [m] and outward unit normals, shape (N, 6).
        T_task_gripper: Grasp poses, shape (G, 4, 4); fastest if those near to each
            other come in a row.
        opening: Distance of the inner pad faces in [m].
        hand: From ``collision.hand_measures``.
        band: Points this near to the outermost one take the pad's pressure, in [m].
        threads: Worker threads.
    """
    half_size = np.array([hand[0], opening / 2, hand[2]])
    cloud = np.ascontiguousarray(cloud, dtype=np.float64)
    poses = np.ascontiguousarray(T_task_gripper, dtype=np.float64)
    found = np.zeros((len(poses), 4))

    def run(part: slice) -> None:
        _inspect(cloud, poses[part], NEIGHBOURS, half_size, band, found[part])

    run_in_parts(run, len(poses), threads)
    worse = np.minimum(found[:, 2], found[:, 3])
    better = np.maximum(found[:, 2], found[:, 3])
    return JawContent(found[:, 0], found[:, 1], worse, better)
