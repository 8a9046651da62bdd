# SPDX-License-Identifier: Apache-2.0
import numpy as np
import torch

from neugrasp_ros.scene.grid_reading import read_trilinear


def test_points_read_what_torch_reads_even_beyond_the_border():
    rng = np.random.default_rng(0)
    table = rng.normal(size=(5, 7, 3, 4)).astype(np.float32)
    points = rng.uniform(-0.2, 1.2, (200, 3)).astype(np.float32)
    where = torch.from_numpy(2 * points[:, ::-1].copy() - 1)
    expected = torch.nn.functional.grid_sample(
        torch.from_numpy(table).permute(3, 0, 1, 2)[None],
        where[None, :, None, None],
        mode="bilinear",
        padding_mode="border",
        align_corners=False,
    )
    np.testing.assert_allclose(
        read_trilinear(table, points), expected[0, :, :, 0, 0].T, atol=1e-5
    )


def test_a_point_that_is_nowhere_reads_nothing_else():
    table = np.ones((4, 4, 4, 2), dtype=np.float32)
    points = np.array([[np.nan] * 3, [np.inf] * 3, [0.5] * 3], dtype=np.float32)
    read = read_trilinear(table, points)
    assert read.shape == (3, 2)
    np.testing.assert_array_equal(read[2], 1.0)


def test_no_points_read_nothing():
    table = np.zeros((2, 2, 2, 3), dtype=np.float32)
    assert read_trilinear(table, np.zeros((0, 3), dtype=np.float32)).shape == (0, 3)
