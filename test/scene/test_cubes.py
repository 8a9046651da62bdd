# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.scene.cubes import (
    blend_shares,
    busy,
    centrality,
    cover,
    cut,
    merge_fields,
    shares_at,
)

SIZE = 16


@pytest.mark.parametrize("shape", [(16, 16, 16), (40, 33, 16), (10, 50, 20)])
def test_every_voxel_is_covered_and_neighbours_overlap(shape):
    corners = cover(shape, SIZE, 5)
    covered = np.zeros(shape, dtype=bool)
    for x, y, z in corners:
        covered[x : x + SIZE, y : y + SIZE, z : z + SIZE] = True
    assert covered.all()
    assert (corners >= 0).all()
    assert (corners + SIZE <= np.maximum(shape, SIZE)).all()
    for axis in range(3):
        places = np.unique(corners[:, axis])
        assert (np.diff(places) <= SIZE - 5).all()


def test_a_workspace_of_the_networks_size_has_one_cube():
    assert cover((16, 16, 16), SIZE, 5).tolist() == [[0, 0, 0]]


def test_a_cut_is_padded_with_what_was_never_observed():
    volume = np.arange(20 * 10 * 16, dtype=np.float32).reshape(20, 10, 16)
    cube = cut(volume, np.array([4, 0, 0]), SIZE)
    np.testing.assert_array_equal(cube[:, :10], volume[4:])
    assert np.isnan(cube[:, 10:]).all()


def test_centrality_is_the_distance_from_the_border():
    corners = np.array([[0, 0, 0], [8, 0, 0]])
    found = centrality(np.array([[10.0, 8, 8], [1, 8, 8]]), corners, SIZE)
    assert found.tolist() == [[6, 2], [1, -7]]


def test_cubes_without_a_thing_of_their_own_are_skipped():
    distances = np.ones((40, 16, 16), dtype=np.float32)
    distances[:, :, :3] = 0.0  # the table
    distances[4:8, 4:8, 3:7] = 0.0  # a thing deep in the first cube
    corners = cover(distances.shape, SIZE, 4)
    assert busy(distances, corners, SIZE, 3.0).tolist() == [True, False, False]
    distances[4:8] = 1.0
    assert not busy(distances, corners, SIZE, 3.0).any()


def test_shares_add_up_to_one_and_favour_the_middle():
    shape = (40, 28, 16)
    corners = cover(shape, SIZE, 6)
    shares = blend_shares(corners, SIZE, shape)
    ones = merge_fields([np.ones_like(s) for s in shares], shares, corners, shape, -8)
    np.testing.assert_allclose(ones, 1.0, atol=1e-5)
    assert all(share[8, 8, 8] > 0.6 for share in shares)


def test_a_field_cut_into_cubes_is_merged_without_seams():
    shape = (40, 28, 16)
    field = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    corners = cover(shape, SIZE, 6)
    parts = [cut(field, corner, SIZE) for corner in corners]
    shares = blend_shares(corners, SIZE, shape)
    merged = merge_fields(parts, shares, corners, shape, -8.0)
    np.testing.assert_allclose(merged, field, atol=1e-5)


def test_a_lonely_cube_counts_to_its_end_and_nothing_lies_beyond():
    corners = cover((40, 16, 16), SIZE, 4)[[0, 2]]
    shares = blend_shares(corners, SIZE, (40, 16, 16))
    fields = [np.full((SIZE,) * 3, 2.0, np.float32)] * 2
    merged = merge_fields(fields, shares, corners, (40, 16, 16), -8.0)
    assert merged[:16] == pytest.approx(2.0)
    assert (merged[16:24] == -8.0).all()


def test_shares_at_the_samples_are_those_of_the_grid():
    shape = (24, 16, 16)
    corners = cover(shape, SIZE, 6)
    shares = blend_shares(corners, SIZE, shape)
    index = np.argwhere(np.ones(shape))
    found = shares_at(index + 0.5, corners, SIZE)
    assert len(corners) == 2
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-6)
    for number, (share, corner) in enumerate(zip(shares, corners, strict=True)):
        inside = ((index >= corner) & (index < corner + SIZE)).all(axis=1)
        expected = share[tuple((index[inside] - corner).T)]
        np.testing.assert_allclose(found[inside, number], expected, atol=1e-6)
    assert (shares_at(np.array([[-1.0, 3.0, 3.0]]), corners, SIZE) == 0).all()
