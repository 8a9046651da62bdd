# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.raycast import MeshScene
from sim_bridge.objects.mesh_repair import is_watertight
from sim_bridge.objects.model import part_mesh, part_volume
from sim_bridge.objects.shapes.building import (
    arc_path,
    box,
    cup,
    cylinder,
    disc,
    ellipsoid,
    loft,
    mirrored,
    moved,
    ring,
    rod,
    sheet,
    sweep,
    wall,
)


def total_volume(parts):
    return sum(part_volume(part) for part in parts)


def contains(parts, points):
    meshes = [part_mesh(part) for part in parts]
    scene = MeshScene(meshes, np.broadcast_to(np.eye(4), (len(meshes), 4, 4)))
    return scene.contains(np.array(points))


def test_box_takes_full_edges_and_turns_about_z():
    bounds = part_mesh(box((0.2, 0.1, 0.3), (1, 0, 0), yaw=np.pi / 2)).bounds()
    np.testing.assert_allclose(bounds, [[0.95, -0.1, -0.15], [1.05, 0.1, 0.15]])


@pytest.mark.parametrize(("axis", "index"), [("x", 0), ("y", 1), ("z", 2)])
def test_cylinder_lies_along_its_axis(axis, index):
    extents = np.ptp(part_mesh(cylinder(0.01, 0.5, (0, 0, 0), axis)).bounds(), axis=0)
    assert extents[index] == pytest.approx(0.5)
    assert np.delete(extents, index) == pytest.approx(0.02, rel=0.01)


@pytest.mark.parametrize("end", [(0, 0, 1), (0, 0, -1), (1, 2, -3)])
def test_rod_reaches_one_radius_beyond_its_ends(end):
    part = rod((0, 0, 0), end, 0.1)
    direction = np.array(end) / np.linalg.norm(end)
    heights = part_mesh(part).vertices @ direction
    assert heights.min() == pytest.approx(-0.1)
    assert heights.max() == pytest.approx(np.linalg.norm(end) + 0.1)
    assert np.linalg.det(part.pose[:3, :3]) == pytest.approx(1.0)


def test_ring_is_an_ellipse_or_nearly_a_rectangle():
    circle = ring((0.0, 2.0, 2.0))
    np.testing.assert_allclose(np.linalg.norm(circle, axis=1), 2.0)
    square = np.abs(ring((0.0, 1.0, 1.0), squareness=30.0)).max(axis=1)
    assert (square > 0.95).all()


def test_loft_between_equal_circles_is_a_prism():
    n = 20
    prism = loft([disc(0, 1.0), disc(2, 1.0)])
    assert part_volume(prism) == pytest.approx(2 * n / 2 * np.sin(2 * np.pi / n))


def test_wall_encloses_the_volume_between_two_polygons():
    n = 12
    parts = wall([disc(0, 0.9), disc(1, 0.9)], [disc(0, 1.0), disc(1, 1.0)])
    polygon = n / 2 * np.sin(2 * np.pi / n)
    assert len(parts) == n
    assert total_volume(parts) == pytest.approx(polygon * (1 - 0.81))


def test_cup_is_hollow_and_has_a_floor():
    parts = cup([disc(0, 0.04), disc(0.1, 0.04)], 0.004)
    middle = np.pi / 12  # of a wedge: its seams are nobody's
    in_wall = [0.0375 * np.cos(middle), 0.0375 * np.sin(middle), 0.05]
    inside = contains(parts, [[0, 0, 0.05], [0, 0, 0.002], in_wall])
    assert inside.tolist() == [False, True, True]


def test_straight_sweep_is_a_box_and_a_bent_one_keeps_its_thickness():
    straight = sweep(np.array([[0, 0, 0], [1.0, 0, 0]]), (0.2, 0.1), (0, 1, 0))
    np.testing.assert_allclose(
        np.ptp(part_mesh(straight[0]).bounds(), axis=0), [1, 0.2, 0.1]
    )
    bent = sweep(
        np.array([[0, 0, 0], [1.0, 0, 0], [1.0, 0, 1.0]]), (0.2, 0.1), (0, 1, 0)
    )
    assert total_volume(bent) == pytest.approx(2 * 0.2 * 0.1)
    np.testing.assert_allclose(
        part_mesh(bent[0]).bounds()[:, 2], [-0.05, 0.05], atol=1e-9
    )


def test_round_sweep_has_eight_sides_about_its_middle():
    (bar,) = sweep(
        np.array([[0, 0, 0], [0, 0, 1.0]]), (0.2, 0.2), (0, 1, 0), round_section=True
    )
    octagon = 8 * 0.1**2 * np.tan(np.pi / 8)
    assert part_volume(bar) == pytest.approx(octagon)


def test_arc_path_runs_in_its_plane():
    path = arc_path((1, 2, 3), (0.5, 0.25), (0, np.pi), 4, "yz")
    np.testing.assert_allclose(path[:, 0], 1)
    np.testing.assert_allclose(path[[0, 2, 4], 1:], [[2.5, 3], [2, 3.25], [1.5, 3]])


def test_sheet_and_ellipsoid_have_their_sizes():
    plate = sheet([(0, 0), (1, 0), (0, 1)], 0.1, z=0.5)
    assert part_volume(plate) == pytest.approx(0.05)
    assert part_mesh(plate).bounds()[:, 2] == pytest.approx([0.45, 0.55])
    egg = part_mesh(ellipsoid((0.1, 0.2, 0.3), (0, 0, 1)))
    assert egg.bounds()[:, 2] == pytest.approx([0.7, 1.3])
    assert is_watertight(egg)


def test_moved_turns_first_and_relabels():
    (part,) = moved(
        [box((0.2, 0.1, 0.1), (1, 0, 0))], (0, 0, 1), (0, 0, np.pi / 2), "x"
    )
    np.testing.assert_allclose(part.pose[:3, 3], [0, 1, 1], atol=1e-12)
    assert part.label == "x"


def test_mirrored_parts_are_proper_and_on_the_other_side():
    shape = [rod((1, 0, 0), (2, 0.5, 0.3), 0.1), sheet([(1, 0), (2, 0), (1, 1)], 0.1)]
    for part, twin in zip(shape, mirrored(shape), strict=True):
        assert np.linalg.det(twin.pose[:3, :3]) == pytest.approx(1.0)
        assert part_volume(twin) == pytest.approx(part_volume(part))
        low, high = part_mesh(part).bounds()
        np.testing.assert_allclose(
            part_mesh(twin).bounds(),
            [[-high[0], *low[1:]], [-low[0], *high[1:]]],
            atol=2e-3,
        )
