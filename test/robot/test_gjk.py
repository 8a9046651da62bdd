# SPDX-License-Identifier: Apache-2.0
import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from neugrasp_ros.robot.gjk import closer_than, still_apart

CUBE = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3), axis=-1).reshape(-1, 3)


def posed(vertices, rotation=None, position=(0.0, 0.0, 0.0)):
    rotation = np.eye(3) if rotation is None else rotation
    return vertices, np.ascontiguousarray(rotation), np.array(position, dtype=float)


def closer(first, second, margin):
    d = first[2] - second[2]
    return closer_than(first, second, margin, (d[0], d[1], d[2]), np.zeros(3))


@pytest.mark.parametrize("gap", [0.0011, 0.01, 0.3])
def test_face_to_face_distance(gap):
    first, second = posed(CUBE), posed(CUBE, position=(1 + gap, 0.2, -0.1))
    assert not closer(first, second, gap - 1e-6)
    assert closer(first, second, gap + 1e-6)


def test_edge_to_edge_distance():
    quarter = Rotation.from_euler("z", 45, degrees=True).as_matrix()
    tilted = Rotation.from_euler("y", 45, degrees=True).as_matrix()
    # edge of one along z, of the other along y, both 0.5 sqrt 2 from their centres
    gap = 0.02
    first = posed(CUBE, quarter)
    second = posed(CUBE, tilted, (np.sqrt(2) + gap, 0.0, 0.0))
    assert not closer(first, second, gap - 1e-6)
    assert closer(first, second, gap + 1e-6)


def test_corner_to_face_distance():
    # a cube on its corner: the corner is sqrt(3) / 2 from the centre
    turn, _ = Rotation.align_vectors([[1, 0, 0]], [[1, 1, 1]])
    gap = 0.05
    second = posed(CUBE, turn.as_matrix(), (0.5 + np.sqrt(3) / 2 + gap, 0.1, 0.1))
    assert not closer(posed(CUBE), second, gap - 1e-6)
    assert closer(posed(CUBE), second, gap + 1e-6)


@pytest.mark.parametrize("offset", [0.0, 0.3, 0.999])
def test_overlap_is_contact(offset):
    assert closer(posed(CUBE), posed(CUBE, position=(offset, 0, 0)), 1e-6)


def test_one_inside_the_other_is_contact():
    assert closer(posed(CUBE), posed(0.1 * CUBE, position=(0.2, 0.1, 0.0)), 1e-6)


def test_points_and_flat_shapes_work(rng):
    point = np.zeros((1, 3))
    square = np.array([[x, y, 0.0] for x in (-1.0, 1.0) for y in (-1.0, 1.0)])
    for height in (0.1, 0.5):
        first = posed(point, position=(0.3, 0.2, height))
        assert not closer(first, posed(square), height - 1e-6)
        assert closer(first, posed(square), height + 1e-6)


def coal_hull(vertices):
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(0, len(vertices))
    mesh.addVertices(vertices)
    mesh.endModel()
    mesh.buildConvexHull(False, "Qt")
    return mesh.convex


def test_random_hulls_agree_with_coal(rng):
    for _ in range(100):
        a, b = rng.normal(size=(2, 12, 3)) * 0.1
        turn, position = Rotation.random(rng=rng).as_matrix(), rng.normal(size=3) * 0.3
        distance = coal.distance(
            coal_hull(a),
            coal.Transform3s(turn, position),
            coal_hull(b),
            coal.Transform3s(np.eye(3), np.zeros(3)),
            coal.DistanceRequest(),
            coal.DistanceResult(),
        )
        first, second = posed(a, turn, position), posed(b)
        assert closer(first, second, max(distance, 0.0) + 1e-4)
        if distance > 1e-3:
            assert not closer(first, second, distance - 1e-4)


def test_a_separating_direction_is_remembered_and_can_expire():
    first, near, far = (
        posed(CUBE),
        posed(CUBE, position=(1.05, 0, 0)),
        posed(CUBE, position=(2, 0, 0)),
    )
    split = np.zeros(3)
    assert not still_apart(first, far, 0.01, split)  # nothing is known yet
    assert not closer_than(first, far, 0.01, (-2.0, 0.0, 0.0), split)
    assert np.linalg.norm(split) == pytest.approx(1.0)
    assert still_apart(first, far, 0.01, split)
    assert still_apart(first, near, 0.01, split)
    assert not still_apart(first, near, 0.1, split)
    assert not still_apart(first, posed(CUBE, position=(0.9, 0, 0)), 0.01, split)
