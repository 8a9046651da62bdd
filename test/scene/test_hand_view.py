# SPDX-License-Identifier: Apache-2.0
"""The surroundings of a hand are seen the same way round, whichever way they lie."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.nn.functional import binary_cross_entropy_with_logits as bce

from neugrasp_ros.config import NetworkConfig
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.scene.encoder import volume_channels
from neugrasp_ros.scene.hand_view import (
    LENGTH,
    WIDTH,
    HandView,
    along_things,
    hands_at,
    pictures,
)
from neugrasp_ros.scene.heights import USUAL_LEVEL, relief_of

SIZE = 64
TRUNCATION = 4.0  # voxels
CONFIG = NetworkConfig(affordances=("cut", "stab"), context=4, hand_view=8)
DOWN = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])  # breadth along x


def volume_of(heights: np.ndarray) -> torch.Tensor:
    """Channels of surfaces (D, D) at heights in voxels, seen from above."""
    layers = np.arange(SIZE) + 0.5
    distances = (layers - heights[..., None]) / TRUNCATION
    distances = np.where(distances < -1, np.nan, np.minimum(distances, 1))
    return torch.from_numpy(volume_channels(distances.astype(np.float32)))[None]


def table(level: float = 10.3) -> np.ndarray:
    return np.full((SIZE, SIZE), level)


def hand(center: tuple[float, float], turn: float = 0.0):
    """A hand from above, its breadth turned from x, at a place in voxels."""
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ DOWN
    where = np.array([*center, 12.0]) / SIZE
    return hands_at(
        torch.from_numpy(where.astype(np.float32))[None, None],
        torch.from_numpy(axes.astype(np.float32))[None, None],
    )


@pytest.mark.parametrize("level", [7.0, 10.3, 13.75])
def test_a_relief_is_finer_than_a_voxel_and_counts_from_the_table(level):
    heights = table(level)
    heights[20:26, 30:50] += 0.8
    relief = relief_of(volume_of(heights))
    assert relief.levels.item() * SIZE == pytest.approx(level, abs=0.02)
    assert relief.seen.all()
    expected = torch.from_numpy(heights - level)[None].float()
    torch.testing.assert_close(relief.heights * SIZE, expected, atol=0.03, rtol=0)


def test_where_nothing_is_seen_there_is_no_height():
    nothing = np.full((SIZE,) * 3, np.nan, dtype=np.float32)
    relief = relief_of(torch.from_numpy(volume_channels(nothing))[None])
    assert not relief.seen.any()
    assert not relief.heights.any()
    assert relief.levels.item() == pytest.approx(USUAL_LEVEL)


@pytest.mark.parametrize("quarter", range(4))
def test_a_hand_that_turns_with_the_scene_sees_the_same(quarter):
    heights = table()
    heights[30:56, 29:35] += 2.0
    heights[50:56, 26:38] += 3.0
    ahead = pictures(relief_of(volume_of(heights)), hand((32, 32)))
    turned = np.rot90(heights, quarter).copy()
    there = pictures(relief_of(volume_of(turned)), hand((32, 32), quarter * np.pi / 2))
    assert ahead.shape == (1, 4, LENGTH, WIDTH)
    torch.testing.assert_close(ahead, there, atol=1e-3, rtol=1e-3)
    assert ahead[0, 0, LENGTH // 2 + 18].max() > 1.0 > ahead[0, 0, 10].max()


def test_a_steep_breadth_leaves_the_word_to_the_approach():
    side = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # approach along x
    axes = torch.from_numpy(np.stack([side, DOWN]).astype(np.float32))[None]
    hands = hands_at(torch.zeros(1, 2, 3), axes)
    torch.testing.assert_close(hands.along[0], torch.tensor([[1.0, 0], [1, 0]]))
    torch.testing.assert_close(
        hands.approach[0], torch.tensor([[1.0, 0, 0], [0, 0, -1]])
    )


def bar(turn: float, first: float, last: float, width: float) -> np.ndarray:
    """Cells of a bar from one distance to another of the middle, turned from x."""
    x, y = np.meshgrid(np.arange(SIZE) - 31.5, np.arange(SIZE) - 31.5, indexing="ij")
    u = x * np.cos(turn) + y * np.sin(turn)
    v = -x * np.sin(turn) + y * np.cos(turn)
    return (u > first) & (u < last) & (np.abs(v) < width / 2)


@pytest.mark.parametrize("turn", [0.0, 0.9, 2.0, -2.8])
@pytest.mark.parametrize("askew", [-0.6, 0.0, 0.7])
def test_a_hand_is_turned_along_what_it_grips_and_onto_its_middle(turn, askew):
    relief = relief_of(volume_of(table() + 1.5 * bar(turn, -6, 20, 5)))
    across = np.array([-np.sin(turn), np.cos(turn)])
    hands = hand(tuple(32 + 1.5 * across), turn + askew)  # 1.5 voxels beside it
    turned = along_things(relief, hands)
    expected = torch.tensor([np.cos(turn), np.sin(turn)]).float()
    assert (turned.along[0, 0] @ expected).item() > np.cos(0.05)
    moved = (turned.centers[0, 0, :2].numpy() * SIZE - 32) @ across
    assert abs(moved) < 0.3
    assert turned.centers[0, 0, 2] == hands.centers[0, 0, 2]
    assert torch.equal(turned.approach, hands.approach)


def test_hands_stay_as_they_are_where_nothing_is_long():
    round_thing = np.hypot(*np.mgrid[-31.5:32, -31.5:32]) < 5
    for heights in (table(), table() + 2.0 * round_thing):
        hands = hand((32, 33), 0.4)
        turned = along_things(relief_of(volume_of(heights)), hands)
        torch.testing.assert_close(turned.along, hands.along)
        torch.testing.assert_close(turned.centers, hands.centers)


def test_a_high_hand_still_sees_what_is_at_its_height():
    heights = table()
    heights[30:34, 30:34] += 22.0
    relief = relief_of(volume_of(heights))
    where = torch.tensor([[[0.5, 0.5, 32.3 / SIZE]]])  # 22 voxels over the table
    axes = torch.from_numpy(DOWN.astype(np.float32))[None, None]
    near = pictures(relief, hands_at(where, axes))[0, 2]
    assert near[LENGTH // 2, WIDTH // 2].abs() < 0.1
    assert near[LENGTH // 2 + 12, WIDTH // 2] == -1


@pytest.mark.slow
def test_what_the_far_end_looks_like_is_learned_for_every_direction():
    rng = np.random.default_rng(0)
    torch.manual_seed(0)

    def scene() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, float]:
        """A bar from a hand held askew on; a wide end says 1."""
        turn, wide = rng.uniform(0, 2 * np.pi), rng.random() < 0.5
        there = bar(turn, -4, 24, 4) | (wide & bar(turn, 18, 24, 10))
        pose = hand((32, 32), turn + rng.uniform(-0.7, 0.7))
        volume = volume_of(table(rng.uniform(9, 12)) + 0.8 * there)
        return volume[0], pose.centers[0], pose, float(wide)

    def batch(count: int):
        drawn = [scene() for _ in range(count)]
        relief = relief_of(torch.stack([volume for volume, *_ in drawn]))
        hands = type(drawn[0][2])(
            *(torch.cat(parts) for parts in zip(*(d[2] for d in drawn), strict=True))
        )
        return relief, hands, torch.tensor([d[3] for d in drawn])

    view = HandView(CONFIG)
    optimiser = torch.optim.AdamW(view.parameters(), 3e-3)
    for _ in range(150):
        relief, hands, wide = batch(16)
        loss = bce(view.classes(view(relief, hands))[:, 1], wide)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    view.eval()
    relief, hands, wide = batch(64)
    with torch.no_grad():
        said = view.classes(view(relief, hands))[:, 1] > 0
    assert (said == wide.bool()).float().mean() > 0.9


def test_a_view_along_the_hand_needs_a_context():
    with pytest.raises(ConfigError, match="hand_view needs a context"):
        replace(CONFIG, context=0)
