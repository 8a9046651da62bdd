# SPDX-License-Identifier: Apache-2.0
from dataclasses import fields

import numpy as np
import pytest

from neugrasp_ros.errors import ShardError
from neugrasp_ros.training.cache import (
    POINT_SCALE,
    SceneEntry,
    entry_paths,
    load_entry,
    save_entry,
)


def some_entry(seed: int = 0, points: int = 37) -> SceneEntry:
    rng = np.random.default_rng(seed)
    return SceneEntry(
        rng.integers(-128, 128, (2, 8, 8, 8)).astype(np.int8),
        np.tile(np.eye(4), (2, 1, 1)),
        rng.integers(0, int(POINT_SCALE) + 1, (points, 3)).astype(np.uint16),
        rng.random(points) < 0.3,
        rng.integers(0, int(POINT_SCALE) + 1, (5, 3)).astype(np.uint16),
        rng.integers(0, 2, (5, 7)).astype(np.uint8),
        rng.integers(0, 2, (5, 7)).astype(np.uint8),
    )


def test_an_entry_comes_back_as_it_was(tmp_path):
    entry, path = some_entry(), tmp_path / "0.npz"
    save_entry(entry, path)
    loaded = load_entry(path)
    for field in fields(SceneEntry):
        kept, now = getattr(entry, field.name), getattr(loaded, field.name)
        assert now.dtype == kept.dtype
        np.testing.assert_array_equal(now, kept)


@pytest.fixture
def without(tmp_path):
    """Make an entry whose file lacks what begins so."""

    def save(lacking):
        entry, path = some_entry(), tmp_path / "0.npz"
        save_entry(entry, path)
        with np.load(path) as file:
            kept = {k: file[k] for k in file.files if not k.startswith(lacking)}
        np.savez_compressed(path, **kept)
        return entry, path

    return save


def test_points_without_what_the_thing_affords_are_told(without):
    _, path = without("part_things")
    with pytest.raises(ShardError, match="lack what the whole thing affords; remove"):
        load_entry(path)


def test_an_entry_of_an_older_cache_has_no_labelled_points(without):
    entry, path = without("part_")
    loaded = load_entry(path)
    assert loaded.part_points.shape == (0, 3)
    assert loaded.part_classes.shape == loaded.part_things.shape == (0, 7)
    np.testing.assert_array_equal(loaded.points, entry.points)


def test_only_whole_entries_appear_and_in_order(tmp_path):
    for number in (10, 2, 1):
        save_entry(some_entry(number), tmp_path / f"{number:05d}.npz")
    (tmp_path / "00003.part").write_bytes(b"half")
    assert [p.stem for p in entry_paths(tmp_path)] == ["00001", "00002", "00010"]


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9])
def test_a_truncated_entry_is_told(tmp_path, share):
    path = tmp_path / "0.npz"
    save_entry(some_entry(), path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ShardError, match="0.npz: not a whole scene entry"):
        load_entry(path)


@pytest.mark.parametrize("place", [0.05, 0.3, 0.5])
def test_a_damaged_entry_is_told(tmp_path, place):
    path = tmp_path / "0.npz"
    save_entry(some_entry(), path)
    content = bytearray(path.read_bytes())
    start = int(place * len(content))
    content[start : start + 8] = bytes(8)
    path.write_bytes(content)
    with pytest.raises(ShardError, match="not a whole scene entry"):
        load_entry(path)


def test_an_entry_without_a_part_is_told(tmp_path):
    path = tmp_path / "0.npz"
    np.savez(path, volumes=np.zeros(3))
    with pytest.raises(ShardError, match="points"):
        load_entry(path)


def test_a_missing_entry_is_told(tmp_path):
    with pytest.raises(ShardError, match=r"none\.npz"):
        load_entry(tmp_path / "none.npz")
