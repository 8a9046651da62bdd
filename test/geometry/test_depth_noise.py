# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.depth_noise import add_camera_noise, add_mod_dex

SHAPE = (60, 81)
FACING = np.zeros(SHAPE)  # incidence of a wall seen head-on


def wall(depth: float = 0.6) -> np.ndarray:
    return np.full(SHAPE, depth, dtype=np.float32)


def draw(noise, count: int):
    return [noise(np.random.default_rng(seed)) for seed in range(count)]


def test_mod_dex_scales_the_whole_image_and_half_the_time_bends_it():
    images = draw(lambda rng: add_mod_dex(wall(), rng), 200)
    scales = np.array([image.mean() / 0.6 for image in images])
    flat = np.array([np.ptp(image) < 1e-6 for image in images])
    assert 0.4 < flat.mean() < 0.6
    assert scales[flat].std() == pytest.approx(0.0316, rel=0.25)
    bent = np.stack([i - i.mean() for i, f in zip(images, flat, strict=True) if not f])
    assert 0.002 < bent.std() < 0.006  # 5 mm at the nodes, less between them


def test_camera_noise_has_its_parts():
    images = np.stack(draw(lambda rng: add_camera_noise(wall(), FACING, rng), 60))
    assert np.isfinite(images).all()
    assert (images.mean(axis=(1, 2)) / 0.6).std() == pytest.approx(0.004, rel=0.3)
    neighbours = np.diff(images, axis=2)[:, :, ::4]
    assert 0.001 < neighbours.std() < 0.0025  # 1 mm a pixel, and a little of the field


def test_noise_of_a_pixel_grows_with_the_square_of_its_depth():
    near, far = (
        np.stack(draw(lambda rng, z=z: add_camera_noise(wall(z), FACING, rng), 20))
        for z in (0.6, 2.4)
    )
    ratio = np.diff(far, axis=2).std() / np.diff(near, axis=2).std()
    assert 8 < ratio < 16


def test_half_of_the_grazing_pixels_drop_out_and_no_other():
    incidence = np.zeros(SHAPE)
    incidence[:, :20] = np.deg2rad(85)
    dropped = np.isnan(add_camera_noise(wall(), incidence, np.random.default_rng(0)))
    assert dropped[:, :20].mean() == pytest.approx(0.5, abs=0.06)
    assert not dropped[:, 20:].any()


def test_half_of_the_pixels_at_a_depth_jump_drop_out():
    depth = wall()
    depth[:, 40:] = 0.63
    images = draw(lambda rng: add_camera_noise(depth, FACING, rng), 10)
    dropped = np.isnan(np.stack(images)).mean(axis=(0, 1))
    assert dropped[39:41] == pytest.approx(0.5, abs=0.06)
    assert not np.delete(dropped, (39, 40)).any()


@pytest.mark.parametrize(
    "noise",
    [add_mod_dex, lambda depth, rng: add_camera_noise(depth, FACING, rng)],
    ids=["mod_dex", "camera"],
)
def test_noise_follows_the_seed_keeps_holes_and_leaves_its_input_alone(noise):
    depth = wall()
    depth[3, 4] = np.nan
    before = depth.copy()
    first, second = (noise(depth, np.random.default_rng(5)) for _ in "ab")
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(depth, before)
    assert np.isnan(first[3, 4])
    assert first.dtype == np.float32
    assert first.shape == SHAPE
