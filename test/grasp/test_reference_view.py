# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import make_transform
from neugrasp_ros.grasp.reference_view import render_local_reference

DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
CENTER = np.array([0.15, 0.15, 0.1])
FOV = np.deg2rad(120.0)


class Ball:
    """A ball, as the reference asks about scenes."""

    edge = 0.3

    def __init__(self, radius: float) -> None:
        self._radius = radius

    def clipped(self, points):
        depth = self._radius - np.linalg.norm(points - CENTER, axis=1)
        return np.clip(2000 * depth, -8, 8).astype(np.float32)

    def __call__(self, points):
        return 1 / (1 + np.exp(-self.clipped(points)))


def look(radius: float, **options):
    poses = make_transform(DOWN, CENTER)[None]
    return render_local_reference(
        Ball(radius), poses, load_gripper("panda"),
        n_points=64, fov=FOV, kept_size=20, **options,
    )  # fmt: skip


def test_points_lie_on_the_surface_and_normals_look_outward():
    views = look(0.02)
    assert views.hits[0] > 20
    here = views.points[0] * [1, -1, -1]  # about the centre, in the task frame
    radius = np.linalg.norm(here, axis=1)
    np.testing.assert_allclose(radius, 0.02, atol=1e-3)
    outward = here / radius[:, None]
    towards = (views.normals[0] * [1, -1, -1] * outward).sum(axis=1)
    assert towards.min() > 0.9


def test_rays_that_are_not_kept_change_nothing():
    every, kept = look(0.02), look(0.02, cast_all=False)
    for one, other in zip(every, kept, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("radius", "met"), [(0.008, True), (0.0, False)])
def test_few_points_are_kept(radius, met):
    hits = look(radius).hits[0]
    assert (0 < hits < 16) if met else hits == 0
