# SPDX-License-Identifier: Apache-2.0
"""Compiled questions about contact: hull against hull, hull against points.

Each goes from cheap to exact: bounding balls, bounding boxes by separating axes, then
the hulls themselves.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from neugrasp_ros.robot.gjk import closer_than, still_apart
from neugrasp_ros.robot.obstacles import CELL
from neugrasp_ros.robot.posing import make_buffers, pose_world

CELL_RADIUS = CELL * 0.8661  # [m]; from the middle of a cell to its corners

FREE, SELF, SCENE, HAND = 0, 1, 2, 3
"""Contact of nothing, of two links, of a link with the scene, of the hand with it."""


class Scope(NamedTuple):
    """What one planning group can bring into contact.

    Attributes:
        pairs: Hulls whose distance it changes, those of one pair of bodies in a row,
            shape (P, 2).
        body_pairs: Those bodies, the base being J, shape (B, 2).
        pair_starts: Where each body pair's hull pairs begin, shape (B + 1,).
        movers: Hulls that it moves, shape (K,).
        padding: Distance that each of them keeps from obstacles in [m], shape (K,).
        hand: Which of them are its own fingers and palm, shape (K,).
        self_padding: Distance that hulls keep from each other in [m].
    """

    pairs: NDArray[np.int64]
    body_pairs: NDArray[np.int64]
    pair_starts: NDArray[np.int64]
    movers: NDArray[np.int64]
    padding: NDArray[np.float64]
    hand: NDArray[np.bool_]
    self_padding: float


@njit(cache=True, error_model="numpy")
def _apart_across(C, t, a, b, margin):  # type: ignore[no-untyped-def]
    """Try the nine axes that are perpendicular to an edge of each of two boxes."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            reach = a[i1] * abs(C[i2, j]) + a[i2] * abs(C[i1, j])
            reach += b[j1] * abs(C[i, j2]) + b[j2] * abs(C[i, j1]) + margin
            if abs(t[i2] * C[i1, j] - t[i1] * C[i2, j]) > reach:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _boxes_apart(d, first, second, margin, scratch):  # type: ignore[no-untyped-def]
    """Separating-axis test of two boxes.

    Args:
        d: Vector between their centres in [m].
        first: Axes as columns (3, 3) and half extents in [m] (3,) of one.
        second: Those of the other.
        margin: In [m].
        scratch: Shape (4, 3).
    """
    A, a = first
    B, b = second
    C, t = scratch[:3], scratch[3]
    for i in range(3):
        t[i] = A[0, i] * d[0] + A[1, i] * d[1] + A[2, i] * d[2]
        for j in range(3):
            C[i, j] = A[0, i] * B[0, j] + A[1, i] * B[1, j] + A[2, i] * B[2, j]
    for i in range(3):
        reach = a[i] + margin
        for j in range(3):
            reach += b[j] * abs(C[i, j])
        if abs(t[i]) > reach:
            return True
    for j in range(3):
        reach, gap = b[j] + margin, 0.0
        for i in range(3):
            reach += a[i] * abs(C[i, j])
            gap += t[i] * C[i, j]
        if abs(gap) > reach:
            return True
    return _apart_across(C, t, a, b, margin)


@njit(cache=True, error_model="numpy", forceinline=True)
def _hull(hulls, rotations, positions, index):  # type: ignore[no-untyped-def]
    """Return vertices, rotation and position of a posed hull."""
    start, stop = hulls.vertex_starts[index], hulls.vertex_starts[index + 1]
    body = hulls.bodies[index]
    if body < 0:
        body = rotations.shape[0] - 1
    return hulls.vertices[start:stop], rotations[body], positions[body]


@njit(cache=True, error_model="numpy")
def _gap(p, q):  # type: ignore[no-untyped-def]
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


@njit(cache=True, error_model="numpy")
def _within(d, reach):  # type: ignore[no-untyped-def]
    return d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= reach * reach


@njit(cache=True, error_model="numpy", forceinline=True)
def _first_pair(world, scope, buffers):  # type: ignore[no-untyped-def]
    """Return the first pair of hulls closer than the padding, or -1."""
    hulls, margin = world.hulls, scope.self_padding
    rotations, positions, centers, axes, balls, splits, scratch, _ = buffers
    for n in range(scope.body_pairs.shape[0]):
        a, b = scope.body_pairs[n, 0], scope.body_pairs[n, 1]
        reach = world.body_balls[a, 3] + world.body_balls[b, 3] + margin
        if not _within(_gap(balls[a], balls[b]), reach):
            continue
        for k in range(scope.pair_starts[n], scope.pair_starts[n + 1]):
            i, j = scope.pairs[k, 0], scope.pairs[k, 1]
            d = _gap(centers[i], centers[j])
            if not _within(d, hulls.radii[i] + hulls.radii[j] + margin):
                continue
            box_i, box_j = (axes[i], hulls.halves[i]), (axes[j], hulls.halves[j])
            if _boxes_apart(d, box_i, box_j, margin, scratch):
                continue
            first = _hull(hulls, rotations, positions, i)
            second = _hull(hulls, rotations, positions, j)
            split = splits[k]  # what separated this pair the last time
            if still_apart(first, second, margin, split):
                continue
            if closer_than(first, second, margin, d, split):
                return k
    return -1


@njit(cache=True, error_model="numpy", forceinline=True)
def _hits_box(world, g, k, margin, buffers):  # type: ignore[no-untyped-def]
    """Return whether hull ``g`` is closer than the margin to solid box ``k``."""
    hulls, solid = world.hulls, world.obstacles.boxes
    rotations, positions, centers, axes, _, _, scratch, _ = buffers
    d = _gap(centers[g], solid.centers[k])
    mine, other = (axes[g], hulls.halves[g]), (solid.axes[k], solid.halves[k])
    if _boxes_apart(d, mine, other, margin, scratch):
        return False
    base = rotations.shape[0] - 1
    corners = solid.vertices[solid.vertex_starts[k] : solid.vertex_starts[k + 1]]
    second = (corners, rotations[base], positions[base])
    first = _hull(hulls, rotations, positions, g)
    return closer_than(first, second, margin, d, scratch[3])


@njit(cache=True, error_model="numpy")
def point_in_hull(hulls, g, pose, point, margin):  # type: ignore[no-untyped-def]
    """Return whether a point lies in a posed hull whose faces move out by margin."""
    R, p = pose
    x, y, z = point[0] - p[0], point[1] - p[1], point[2] - p[2]
    u = R[0, 0] * x + R[1, 0] * y + R[2, 0] * z
    v = R[0, 1] * x + R[1, 1] * y + R[2, 1] * z
    w = R[0, 2] * x + R[1, 2] * y + R[2, 2] * z
    for f in range(hulls.face_starts[g], hulls.face_starts[g + 1]):
        n = hulls.faces[f]
        if n[0] * u + n[1] * v + n[2] * w > n[3] + margin:
            return False
    return True


@njit(cache=True, error_model="numpy", forceinline=True)
def _outside_box(halves, center, axes, point, margin):  # type: ignore[no-untyped-def]
    """Return whether a point lies outside a box grown by the margin."""
    d = _gap(point, center)
    for j in range(3):
        along = d[0] * axes[0, j] + d[1] * axes[1, j] + d[2] * axes[2, j]
        if abs(along) > halves[j] + margin:
            return True
    return False


@njit(cache=True, error_model="numpy", forceinline=True)
def _cells_along(corner, axis, halves, margin, cells):  # type: ignore[no-untyped-def]
    """Return the first and last cell, of ``cells`` along one axis, that a box reaches.

    ``corner`` is its centre from the cells' corner in [m], ``axis`` how much of each
    of its own axes points along that axis, shape (3,).
    """
    reach = margin
    for j in range(3):
        reach += abs(axis[j]) * halves[j]
    low = max(0, int(np.floor((corner - reach) / CELL)))
    return low, min(cells - 1, int(np.floor((corner + reach) / CELL)))


@njit(cache=True, error_model="numpy", forceinline=True)
def _cell_hits(world, g, margin, posed, held, cell):  # type: ignore[no-untyped-def]
    """Return whether a point of one cell lies in hull ``g``, as ``_hits_point``."""
    hulls, obstacles = world.hulls, world.obstacles
    rotation, position, center, axes = posed
    for k in range(obstacles.starts[cell], obstacles.starts[cell + 1]):
        point = obstacles.points[k]
        if _outside_box(hulls.halves[g], center, axes, point, margin):
            continue
        if held[3] > 0.0 and _within(_gap(point, held), held[3]):
            continue
        if point_in_hull(hulls, g, (rotation, position), point, margin):
            return True
    return False


@njit(cache=True, error_model="numpy", forceinline=True)
def _hits_point(world, g, margin, posed, held):  # type: ignore[no-untyped-def]
    """Return whether an obstacle point lies in hull ``g`` grown by the margin.

    Args:
        world: Robot and obstacles.
        g: The hull.
        margin: In [m].
        posed: Rotation and position of its body, centre and axes of its box.
        held: Ball of points to pass over, centre and radius in [m]; 0 = none.
    """
    obstacles = world.obstacles
    _, _, center, axes = posed
    origin, halves, n = obstacles.origin, world.hulls.halves[g], obstacles.cells
    d = _gap(center, origin)
    i_low, i_high = _cells_along(d[0], axes[0], halves, margin, n[0])
    j_low, j_high = _cells_along(d[1], axes[1], halves, margin, n[1])
    k_low, k_high = _cells_along(d[2], axes[2], halves, margin, n[2])
    for i in range(i_low, i_high + 1):
        x = origin[0] + (i + 0.5) * CELL
        for j in range(j_low, j_high + 1):
            y = origin[1] + (j + 0.5) * CELL
            for k in range(k_low, k_high + 1):
                cell = (i * n[1] + j) * n[2] + k
                if obstacles.starts[cell] == obstacles.starts[cell + 1]:
                    continue
                middle = (x, y, origin[2] + (k + 0.5) * CELL)
                if _outside_box(halves, center, axes, middle, margin + CELL_RADIUS):
                    continue
                if _cell_hits(world, g, margin, posed, held, cell):
                    return True
    return False


@njit(cache=True, error_model="numpy", forceinline=True)
def _near_points(center, reach, origin, cells):  # type: ignore[no-untyped-def]
    """Return whether a ball touches the block of cells that holds all points."""
    for i in range(3):
        corner = center[i] - origin[i]
        if corner + reach < 0.0 or corner - reach > cells[i] * CELL:
            return False
    return True


@njit(cache=True, error_model="numpy", forceinline=True)
def _first_in_scene(world, scope, held, buffers):  # type: ignore[no-untyped-def]
    """Return the number of the first mover that touches an obstacle, or -1."""
    # balls come first: a call that takes the whole world costs more than they do
    rotations, positions, centers, axes, _, _, _, _ = buffers
    hulls, obstacles = world.hulls, world.obstacles
    boxes, some_points = obstacles.boxes, obstacles.points.shape[0] > 0
    nothing = (0.0, 0.0, 0.0, -1.0)
    ball = (held[0], held[1], held[2], held[3])
    for k in range(scope.movers.shape[0]):
        g, margin = scope.movers[k], scope.padding[k]
        for n in range(boxes.radii.shape[0]):
            reach, middle = hulls.radii[g] + margin, boxes.centers[n]
            if _outside_box(boxes.halves[n], middle, boxes.axes[n], centers[g], reach):
                continue
            if _hits_box(world, g, n, margin, buffers):
                return k
        if not scope.hand[k]:
            margin += obstacles.reach
        reach = hulls.radii[g] + margin
        if some_points and _near_points(
            centers[g], reach, obstacles.origin, obstacles.cells
        ):
            body = hulls.bodies[g] if hulls.bodies[g] >= 0 else rotations.shape[0] - 1
            posed = (rotations[body], positions[body], centers[g], axes[g])
            passed = ball if scope.hand[k] else nothing
            if _hits_point(world, g, margin, posed, passed):
                return k
    return -1


@njit(cache=True, error_model="numpy", forceinline=True)
def contact(world, scope, q, known, held, buffers):  # type: ignore[no-untyped-def]
    """Return the first contact of a configuration.

    Args:
        world: Robot and obstacles.
        scope: What to look at.
        q: Configuration, shape (J,).
        known: As of ``pose_world``.
        held: Ball of points that the hand carries: centre and radius in [m], (4,).
        buffers: Scratch from ``make_buffers``.

    Returns:
        ``FREE``, ``SELF`` with the pair, ``SCENE`` or ``HAND`` with the hull.
    """
    pose_world(world, q, known, buffers)
    pair = _first_pair(world, scope, buffers)
    if pair >= 0:
        return SELF, pair
    g = _first_in_scene(world, scope, held, buffers)
    if g >= 0:
        return (HAND if scope.hand[g] else SCENE), scope.movers[g]
    return FREE, -1


@njit(cache=True, error_model="numpy")
def path_contacts(world, scope, starts, joints, paths, held, found):  # type: ignore[no-untyped-def]
    """Write the first contact along each of N paths.

    Args:
        world: Robot and obstacles.
        scope: What to look at.
        starts: Configurations with all other joints' values, shape (N, J).
        joints: Where the paths' joints stand in it, shape (n,).
        paths: Joint values, shape (N, S, n).
        held: For each path the ball that the hand carries, shape (N, 4).
        found: Receives code and number of the contact, see ``contact``, shape (N, 2).
    """
    buffers, q = make_buffers(world, scope.pairs.shape[0]), np.empty(starts.shape[1])
    known = np.full(starts.shape[1], np.nan)
    for i in range(paths.shape[0]):
        q[:] = starts[i]
        found[i, 0], found[i, 1] = FREE, -1
        for s in range(paths.shape[1]):
            for k in range(joints.shape[0]):
                q[joints[k]] = paths[i, s, k]
            found[i] = contact(world, scope, q, known, held[i], buffers)
            if found[i, 0] != FREE:
                break
