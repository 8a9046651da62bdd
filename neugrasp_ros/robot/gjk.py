# SPDX-License-Identifier: Apache-2.0
"""Whether two convex hulls come closer than a margin, compiled [Gilbert1988].

The closest point v of the Minkowski difference A - B to the origin is refined with
support points w; |v| bounds the distance from above and v.w / |v| from below, so that
most questions end after one or two supports.
"""

import numpy as np
from numba import njit

MAX_ITERATIONS = 40
CONVERGED = 1e-8  # of |v|^2, relative


@njit(cache=True, error_model="numpy")
def _support(hull, direction):  # type: ignore[no-untyped-def]
    """Return the vertex of a posed hull that lies farthest in a direction."""
    vertices, rotation, position = hull
    x, y, z = direction
    a = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
    b = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
    c = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z
    best, farthest = 0, -np.inf
    for k in range(vertices.shape[0]):
        value = a * vertices[k, 0] + b * vertices[k, 1] + c * vertices[k, 2]
        if value > farthest:
            best, farthest = k, value
    u, v, w = vertices[best, 0], vertices[best, 1], vertices[best, 2]
    return (
        rotation[0, 0] * u + rotation[0, 1] * v + rotation[0, 2] * w + position[0],
        rotation[1, 0] * u + rotation[1, 1] * v + rotation[1, 2] * w + position[1],
        rotation[2, 0] * u + rotation[2, 1] * v + rotation[2, 2] * w + position[2],
    )


@njit(cache=True, error_model="numpy")
def _dot(p, q):  # type: ignore[no-untyped-def]
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@njit(cache=True, error_model="numpy")
def _less(p, q):  # type: ignore[no-untyped-def]
    return (p[0] - q[0], p[1] - q[1], p[2] - q[2])


@njit(cache=True, error_model="numpy")
def _blend(p, s, q, t, r):  # type: ignore[no-untyped-def]
    """Return p + s q + t r."""
    return (
        p[0] + s * q[0] + t * r[0],
        p[1] + s * q[1] + t * r[1],
        p[2] + s * q[2] + t * r[2],
    )


@njit(cache=True, error_model="numpy")
def _row(simplex, i):  # type: ignore[no-untyped-def]
    return (simplex[i, 0], simplex[i, 1], simplex[i, 2])


@njit(cache=True, error_model="numpy")
def _nearest_on_segment(simplex, i, j):  # type: ignore[no-untyped-def]
    """Return the point of an edge nearest to the origin, and the vertices it needs."""
    a, b = _row(simplex, i), _row(simplex, j)
    ab = _less(b, a)
    length = _dot(ab, ab)
    t = -_dot(a, ab) / length if length > 0.0 else 0.0
    if t <= 0.0:
        return a, 1 << i
    if t >= 1.0:
        return b, 1 << j
    return _blend(a, t, ab, 0.0, ab), (1 << i) | (1 << j)


@njit(cache=True, error_model="numpy")
def _nearest_on_triangle(simplex, i, j, k):  # type: ignore[no-untyped-def]
    """Return the point of a face nearest to the origin, and the vertices it needs."""
    a, b, c = _row(simplex, i), _row(simplex, j), _row(simplex, k)
    ab, ac = _less(b, a), _less(c, a)
    d1, d2 = -_dot(ab, a), -_dot(ac, a)
    d3, d4 = -_dot(ab, b), -_dot(ac, b)
    d5, d6 = -_dot(ab, c), -_dot(ac, c)
    on_bc = d3 * d6 - d5 * d4
    on_ac = d5 * d2 - d1 * d6
    on_ab = d1 * d4 - d3 * d2
    total = on_bc + on_ac + on_ab
    if on_bc > 0.0 and on_ac > 0.0 and on_ab > 0.0 and total > 1e-24:
        inside = _blend(a, on_ac / total, ab, on_ab / total, ac)
        return inside, (1 << i) | (1 << j) | (1 << k)
    best, mask = _nearest_on_segment(simplex, i, j)
    for first, second in ((j, k), (k, i)):
        point, used = _nearest_on_segment(simplex, first, second)
        if _dot(point, point) < _dot(best, best):
            best, mask = point, used
    return best, mask


@njit(cache=True, error_model="numpy")
def _nearest_on_tetrahedron(simplex):  # type: ignore[no-untyped-def]
    """Return the point of a tetrahedron nearest to the origin; mask 15 = inside."""
    best, mask = (0.0, 0.0, 0.0), 15
    closest = np.inf
    for i, j, k, other in ((0, 1, 2, 3), (0, 1, 3, 2), (0, 2, 3, 1), (1, 2, 3, 0)):
        a, b, c = _row(simplex, i), _row(simplex, j), _row(simplex, k)
        ab, ac = _less(b, a), _less(c, a)
        normal = (
            ab[1] * ac[2] - ab[2] * ac[1],
            ab[2] * ac[0] - ab[0] * ac[2],
            ab[0] * ac[1] - ab[1] * ac[0],
        )
        here = -_dot(normal, a)
        there = _dot(normal, _less(_row(simplex, other), a))
        if here * there <= 0.0 or abs(there) < 1e-15:
            point, used = _nearest_on_triangle(simplex, i, j, k)
            if _dot(point, point) < closest:
                best, mask, closest = point, used, _dot(point, point)
    return best, mask


@njit(cache=True, error_model="numpy")
def _nearest(simplex, count):  # type: ignore[no-untyped-def]
    if count == 1:
        return _row(simplex, 0), 1
    if count == 2:
        return _nearest_on_segment(simplex, 0, 1)
    if count == 3:
        return _nearest_on_triangle(simplex, 0, 1, 2)
    return _nearest_on_tetrahedron(simplex)


@njit(cache=True, error_model="numpy")
def still_apart(first, second, margin, split):  # type: ignore[no-untyped-def]
    """Return whether a known direction still separates two hulls by the margin.

    Args:
        first: Vertices in its own frame in [m] (V, 3), rotation (3, 3) and position in
            [m] (3,) of one hull.
        second: The same of the other.
        margin: In [m].
        split: Unit vector from the second towards the first, or zero for none.
    """
    n = (split[0], split[1], split[2])
    if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
        return False
    a = _support(first, (-n[0], -n[1], -n[2]))
    return _dot(n, _less(a, _support(second, n))) > margin


@njit(cache=True, error_model="numpy")
def closer_than(first, second, margin, v, split):  # type: ignore[no-untyped-def]
    """Return whether two posed convex hulls come closer than a margin, or overlap.

    Args:
        first: One hull, as in ``still_apart``.
        second: The other.
        margin: In [m], positive.
        v: Any vector from a point of the second to a point of the first in [m].
        split: Receives the direction that separates them, if one does, shape (3,).
    """
    simplex = np.empty((4, 3))
    count = 0
    for _ in range(MAX_ITERATIONS):
        vv = _dot(v, v)
        if vv <= margin * margin:
            return True
        a = _support(first, (-v[0], -v[1], -v[2]))
        b = _support(second, v)
        w = _less(a, b)
        vw = _dot(v, w)
        if vw > 0.0 and vw * vw > margin * margin * vv:
            length = np.sqrt(vv)
            split[0], split[1], split[2] = v[0] / length, v[1] / length, v[2] / length
            return False
        if count > 0 and vv - vw <= CONVERGED * vv:
            return True  # v is the nearest point, and it is not farther than margin
        simplex[count, 0], simplex[count, 1], simplex[count, 2] = w
        v, mask = _nearest(simplex, count + 1)
        if mask == 15:
            return True
        kept = 0
        for i in range(count + 1):
            if mask & (1 << i):
                simplex[kept] = simplex[i]
                kept += 1
        count = kept
    return True  # undecided within rounding: the safe answer
