# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
import torch

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.scene.encoder import (
    KEPT_AXES,
    VoxelEncoder,
    sample_planes,
    volume_channels,
)

CONFIG = NetworkConfig(
    resolution=16, plane_resolution=8, channels=4, unet_depth=2, unet_channels=4
)


def one_voxel(i: int, j: int, k: int, size: int = 16) -> torch.Tensor:
    """Channels of a volume in which a single voxel differs from free space."""
    distances = np.ones((size,) * 3, dtype=np.float32)
    distances[i, j, k] = -0.5
    return torch.from_numpy(volume_channels(distances))[None]


def encoder_of(stem: str, **changes) -> VoxelEncoder:
    torch.manual_seed(0)
    encoder = VoxelEncoder(replace(CONFIG, stem=stem, **changes)).eval()
    with torch.no_grad():
        for weights in encoder.stem.parameters():
            weights.abs_()  # so that no rectifier hides what a voxel does
    return encoder


@torch.no_grad()
def projected_change(encoder: VoxelEncoder, volume: torch.Tensor) -> torch.Tensor:
    """Return where one voxel changes the planes before the U-Net, (3, R, R)."""
    free = torch.from_numpy(volume_channels(np.ones((16,) * 3, np.float32)))[None]
    change = encoder._project(volume) - encoder._project(free)
    return change[0].abs().amax(dim=1)


def test_channels_separate_seen_near_seen_free_and_never_seen():
    distances = np.array([0.3, -0.7, 0.99, 1.0, 0.98, np.nan], dtype=np.float32)
    signed, free, unknown = volume_channels(distances.reshape(1, 1, 6))[:, 0, 0]
    np.testing.assert_allclose(signed, [0.3, -0.7, 0, 0, 0.98, 0], rtol=1e-6)
    assert free.tolist() == [0, 0, 1, 1, 0, 0]
    assert unknown.tolist() == [0, 0, 0, 0, 0, 1]


def test_channels_of_a_batch_stand_before_the_grid_and_the_input_is_left_alone():
    distances = np.full((2, 4, 4, 4), np.nan, dtype=np.float32)
    assert volume_channels(distances).shape == (2, 3, 4, 4, 4)
    assert np.isnan(distances).all()


@pytest.mark.parametrize("stem", ["axis", "conv3d"])
@pytest.mark.parametrize("plane_resolution", [8, 16])
def test_planes_have_the_promised_shape(stem, plane_resolution):
    encoder = encoder_of(stem, plane_resolution=plane_resolution)
    planes = encoder(torch.zeros(2, 3, 16, 16, 16))
    assert planes.shape == (2, 3, 4, plane_resolution, plane_resolution)


@pytest.mark.parametrize("voxel", [(2, 5, 12), (13, 0, 7), (15, 15, 1)])
def test_a_voxel_reaches_the_cell_of_each_plane_that_covers_it(voxel):
    change = projected_change(encoder_of("axis"), one_voxel(*voxel))
    for plane, (first, second) in enumerate(KEPT_AXES):
        cell = (voxel[second] // 2, voxel[first] // 2)  # two voxels a cell
        active = torch.nonzero(change[plane] > 1e-6).tolist()
        assert active == [list(cell)]


@pytest.mark.parametrize("voxel", [(2, 5, 12), (13, 3, 7)])
def test_the_papers_stem_spreads_a_voxel_by_one(voxel):
    encoder = encoder_of("conv3d", plane_resolution=16)
    change = projected_change(encoder, one_voxel(*voxel))
    for plane, (first, second) in enumerate(KEPT_AXES):
        active = torch.nonzero(change[plane] > 1e-7)
        assert active[:, 0].min() >= voxel[second] - 1
        assert active[:, 0].max() <= voxel[second] + 1
        assert active[:, 1].min() >= voxel[first] - 1
        assert active[:, 1].max() <= voxel[first] + 1
        assert change[plane, voxel[second], voxel[first]] > 1e-7


@pytest.mark.parametrize("stem", ["axis", "conv3d"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_mirroring_a_volume_mirrors_the_cells_it_reaches(stem, axis):
    encoder = encoder_of(stem)
    voxel = [2, 5, 12]
    mirrored = voxel.copy()
    mirrored[axis] = 15 - voxel[axis]
    before = projected_change(encoder, one_voxel(*voxel)) > 1e-7
    after = projected_change(encoder, one_voxel(*mirrored)) > 1e-7
    for plane, (first, second) in enumerate(KEPT_AXES):
        expected = before[plane]
        if axis == second:
            expected = expected.flip(0)
        if axis == first:
            expected = expected.flip(1)
        assert torch.equal(after[plane], expected)


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 1, 0), (0, 2, 1), (1, 2, 0)])
def test_permuting_the_axes_of_a_voxel_permutes_the_planes(order):
    encoder = encoder_of("axis")
    voxel = np.array([2, 5, 12])
    change = projected_change(encoder, one_voxel(*voxel[list(order)])) > 1e-6
    for plane, (first, second) in enumerate(KEPT_AXES):
        cell = voxel[[order[second], order[first]]] // 2
        assert torch.nonzero(change[plane]).tolist() == [cell.tolist()]


def coordinate_planes(size: int, axis: int) -> torch.Tensor:
    """Planes whose cell i holds the coordinate of its centre along ``axis``."""
    middle = (torch.arange(size) + 0.5) / size
    planes = torch.zeros(1, 3, 1, size, size)
    for plane, (first, second) in enumerate(KEPT_AXES):
        if axis == first:
            planes[0, plane, 0] = middle[None, :]
        if axis == second:
            planes[0, plane, 0] = middle[:, None]
    return planes


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_features_are_read_back_half_a_voxel_right(axis):
    centers = (np.arange(8) + 0.5) / 8
    points = np.stack(np.meshgrid(centers, centers, centers), axis=-1).reshape(1, -1, 3)
    points = torch.from_numpy(points.astype(np.float32))
    read = sample_planes(coordinate_planes(8, axis), points)[0]  # (N, 3)
    for plane, axes in enumerate(KEPT_AXES):
        expected = points[0, :, axis] if axis in axes else torch.zeros(len(read))
        torch.testing.assert_close(read[:, plane], expected, atol=1e-6, rtol=0)


def test_between_centres_features_are_bilinear_and_beyond_the_border_constant():
    planes = coordinate_planes(8, axis=0)
    x = torch.tensor([0.3, 0.52, 0.9, 0.0, 1.0, -3.0, 3.0])
    points = torch.full((1, 7, 3), 0.4)
    points[0, :, 0] = x
    read = sample_planes(planes, points)[0, :, 2]
    torch.testing.assert_close(read, x.clamp(0.5 / 8, 7.5 / 8), atol=1e-6, rtol=0)


def test_a_voxel_is_found_again_where_points_in_it_look():
    encoder = encoder_of("axis")
    volume, voxel = one_voxel(2, 5, 12), torch.tensor([2, 5, 12])
    planes = projected_change(encoder, volume)[None, :, None]
    inside = ((voxel // 2 * 2 + 1.0) / 16)[None, None]
    read = sample_planes(planes, inside)[0, 0]
    torch.testing.assert_close(read, planes[0].amax(dim=(1, 2, 3)))


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"plane_resolution": 12},
            "must divide resolution 16, got 12",
        ),
        ({"unet_depth": 5}, "multiple of 16 for a U-Net of unet_depth 5, got 8"),
    ],
)
def test_sizes_that_do_not_fit_are_rejected(changes, told):
    with pytest.raises(ConfigError, match=told):
        encoder_of("axis", **changes)
