# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import torch
from grasp_entries import CLASSES, NORMAL_X, NORMAL_Z, POINTS, SIZE, grasp_entry

from neugrasp_ros.errors import EmptySceneError
from neugrasp_ros.grasp.inputs import POINT_FEATURES, TOKEN_FEATURES
from neugrasp_ros.training.batches import (
    LOCAL_POINTS_PER_SCENE,
    GraspCache,
    make_batch,
    whole_batch,
)
from neugrasp_ros.training.grasps import save_grasps

ENTRIES = [grasp_entry(number) for number in range(4)]


def test_a_batch_has_its_shapes():
    batch = make_batch(ENTRIES[:3], 5, np.random.default_rng(0))
    assert batch.volumes.shape == (3, 3, SIZE, SIZE, SIZE)
    assert batch.points.shape == (3, 5 * POINTS, 3)
    assert batch.point_features.shape == (15, POINTS, POINT_FEATURES)
    assert batch.tokens.shape == (15, TOKEN_FEATURES)
    assert batch.labels.shape == (15,)
    assert batch.affordances.shape == (15, len(CLASSES))
    assert batch.known.shape == batch.judged.shape == (15,)
    assert batch.local_points.shape == (3, LOCAL_POINTS_PER_SCENE, 3)
    assert batch.local_occupied.shape == (3, LOCAL_POINTS_PER_SCENE)
    assert batch.local_classes.shape == (3, LOCAL_POINTS_PER_SCENE, len(CLASSES))
    assert batch.local_known.shape == (3, LOCAL_POINTS_PER_SCENE)
    assert 0.8 < batch.local_known.float().mean() < 1.0
    assert (batch.local_classes.sum(dim=2) == batch.local_known).all()
    types = {name: tensor.dtype for name, tensor in vars(batch).items()}
    for name in ("known", "judged", "local_known"):
        assert types.pop(name) == torch.bool
    assert set(types.values()) == {torch.float32}


def test_all_grasps_come_before_any_comes_again():
    entry = ENTRIES[0]
    batch = make_batch([entry], 20, np.random.default_rng(0))
    tokens = np.abs(batch.tokens.numpy())[:, 0]  # gravity's x: no mirror changes it
    assert len(set(tokens[:12].tolist())) == 12
    assert set(tokens.tolist()) == set(np.abs(entry.tokens[:, 0]).tolist())


def test_labels_stay_with_their_grasps_and_about_half_are_mirrored():
    entry = grasp_entry(0, count=200)
    batch = make_batch([entry], 200, np.random.default_rng(0))
    means = batch.point_features[..., NORMAL_X].mean(dim=1)
    assert torch.equal((means > 0).float(), batch.labels)
    upward = batch.point_features[..., NORMAL_Z].mean(dim=1) > 0
    assert torch.equal(batch.known, batch.labels > 0)
    assert torch.equal(batch.affordances[:, 0] > 0, upward & batch.known)
    row_of = {value: row for row, value in enumerate(entry.tokens[:, 0].tolist())}
    rows = [row_of[value] for value in batch.tokens[:, 0].tolist()]
    mirrored = batch.tokens[:, 1].numpy() == -entry.tokens[rows, 1]
    assert 0.35 < mirrored.mean() < 0.65


def test_a_whole_entry_comes_in_order_and_as_it_was_seen():
    entry = ENTRIES[0]
    batch = whole_batch(entry)
    np.testing.assert_array_equal(batch.tokens.numpy(), entry.tokens)
    np.testing.assert_array_equal(batch.labels.numpy(), entry.labels)
    np.testing.assert_array_equal(
        batch.point_features.numpy(), entry.point_features.astype(np.float32)
    )
    assert batch.local_points.shape == (1, 30, 3)


def test_points_are_in_units_of_the_edge():
    batch = make_batch(ENTRIES, 8, np.random.default_rng(0))
    for points in (batch.points, batch.local_points):
        assert 0 <= points.min() < 0.05
        assert 0.95 < points.max() <= 1


def test_a_folder_of_entries_is_read(tmp_path):
    for number, entry in enumerate(ENTRIES):
        save_grasps(entry, tmp_path / f"{number}.npz")
    cache = GraspCache(tmp_path)
    assert len(cache) == 4
    np.testing.assert_array_equal(cache.entries[2].tokens, ENTRIES[2].tokens)


def test_an_empty_folder_is_told(tmp_path):
    with pytest.raises(EmptySceneError, match="holds no grasp entries"):
        GraspCache(tmp_path)


@pytest.mark.parametrize(("view", "count"), [("grid", 128), ("centre", 1)])
def test_ablations_read_the_same_entries(view, count):
    batch = make_batch(ENTRIES[:2], 3, np.random.default_rng(0), view)
    assert batch.points.shape == (2, 3 * count, 3)
    assert batch.point_features.shape == (6, count, POINT_FEATURES)
    assert whole_batch(ENTRIES[0], view).points.shape == (1, 12 * count, 3)
