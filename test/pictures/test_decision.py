# SPDX-License-Identifier: Apache-2.0
"""The picture of a decision, and the strokes that hands are drawn with."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.pictures.decision import (
    CLOSE_UP,
    Attempt,
    Decision,
    close_up,
    draw_decision,
)
from neugrasp_ros.pictures.scene_axes import gripper_lines


def test_jaws_are_drawn_at_their_width_and_end_at_the_tcp() -> None:
    gripper = load_gripper("panda")
    lines = gripper_lines(np.array([0.04, 0.08]), gripper)
    assert lines.shape == (2, 4, 2, 3)
    tips = lines[:, 2:, 1]
    np.testing.assert_allclose(tips[:, 1, 1] - tips[:, 0, 1], [0.04, 0.08])
    np.testing.assert_allclose(tips[..., 2], 0.0)
    np.testing.assert_allclose(lines[:, 1, :, 2], -gripper.finger_depth)


def _decision(n_grasps: int) -> Decision:
    poses = np.tile(np.eye(4), (n_grasps, 1, 1))
    poses[:, :3, 3] = 0.15
    depth = np.full((48, 64), 0.6, dtype=np.float32)
    depth[:5] = np.nan
    return Decision(
        depth=depth,
        surface=np.random.default_rng(0).uniform(0, 0.3, (50 * n_grasps, 3)),
        candidates=poses,
        candidate_widths=np.full(n_grasps, 0.05),
        grasps=poses,
        widths=np.full(n_grasps, 0.05),
        quality=np.linspace(1, 0, n_grasps),
        lower=np.zeros(3),
        edge=0.3,
    )


def test_picture_is_written_and_shows_something(tmp_path: Path) -> None:
    attempts = [Attempt(0.9, 0.05, True, "lifted"), Attempt(0.6, 0.05, False, "empty")]
    path = tmp_path / "deep" / "demo.png"
    draw_decision(_decision(5), attempts, load_gripper("panda"), path, "a title")
    pixels = np.asarray(Image.open(path).convert("RGB"))
    assert pixels.shape[1] > 3 * pixels.shape[0]
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 200


def test_nothing_found_can_be_drawn_too(tmp_path: Path) -> None:
    path = tmp_path / "none.png"
    draw_decision(_decision(0), [], load_gripper("panda"), path, "nothing")
    assert path.stat().st_size > 1000


def test_the_close_up_is_centred_on_the_surface_and_holds_all_of_it() -> None:
    wide = _decision(5)
    lower, edge = close_up(wide)
    assert edge == np.ptp(wide.surface, axis=0).max() > CLOSE_UP
    assert (
        (wide.surface >= lower - 1e-9) & (wide.surface <= lower + edge + 1e-9)
    ).all()
    lower, edge = close_up(replace(wide, surface=wide.surface / 10))
    assert edge == CLOSE_UP
    np.testing.assert_allclose(lower + edge / 2, 0.015, atol=1e-3)
