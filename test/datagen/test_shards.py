# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from label_work import labels_of

from neugrasp_ros.datagen.shards import (
    GRASP_FIELDS,
    done_indices,
    load_shards,
    merge_shards,
    next_shard_path,
    read_shard,
    shard_paths,
    write_shard,
)
from neugrasp_ros.errors import ShardError


def same(one, other):
    assert (one.index, one.gripper) == (other.index, other.gripper)
    assert (one.scene.kind, one.scene.seed) == (other.scene.kind, other.scene.seed)
    for a, b in zip(one.scene.objects, other.scene.objects, strict=True):
        assert (a.set_name, a.name, a.scale) == (b.set_name, b.name, b.scale)
        np.testing.assert_allclose(a.T_task_object, b.T_task_object, atol=1e-12)
    for name in GRASP_FIELDS:
        a, b = getattr(one.grasps, name), getattr(other.grasps, name)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def test_what_is_written_is_read(tmp_path):
    scenes = [labels_of(3), labels_of(8, n_grasps=0, kind="packed"), labels_of(5)]
    size = write_shard(tmp_path / "shard_000000.npz", scenes)
    assert size == (tmp_path / "shard_000000.npz").stat().st_size
    for one, other in zip(scenes, load_shards(tmp_path), strict=True):
        same(one, other)
    assert done_indices(tmp_path) == {3, 5, 8}


def test_the_view_of_a_scene_is_kept_and_older_shards_have_none(tmp_path):
    path = tmp_path / "shard_000000.npz"
    camera = np.eye(4)
    camera[:3, 3] = [0.1, 0.2, 0.7]
    write_shard(path, [replace(labels_of(3), T_task_camera=camera), labels_of(4)])
    with_view, without = read_shard(path)
    np.testing.assert_array_equal(with_view.T_task_camera, camera)
    assert without.T_task_camera is None
    with np.load(path) as file:
        older = {name: file[name] for name in file.files if name != "scene_camera"}
    np.savez(path, **older)
    assert read_shard(path)[0].T_task_camera is None


def test_a_scene_takes_about_two_kilobytes(tmp_path):
    scenes = [labels_of(i, n_grasps=42) for i in range(50)]
    assert write_shard(next_shard_path(tmp_path), scenes) < 50 * 3000


def test_names_go_on_counting(tmp_path):
    assert next_shard_path(tmp_path).name == "shard_000000.npz"
    write_shard(tmp_path / "shard_000041.npz", [labels_of(0)])
    assert next_shard_path(tmp_path).name == "shard_000042.npz"


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_truncated_shard_is_refused(tmp_path, share):
    path = tmp_path / "shard_000000.npz"
    write_shard(path, [labels_of(0)])
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ShardError, match="damaged or truncated"):
        read_shard(path)


def test_another_format_or_missing_columns_are_refused(tmp_path):
    path = tmp_path / "shard_000000.npz"
    np.savez(path, format=np.array(99))
    with pytest.raises(ShardError, match="format 99, expected 2"):
        read_shard(path)
    np.savez(path, format=np.array(2))
    with pytest.raises(ShardError, match="misses"):
        read_shard(path)


def test_pickled_content_is_never_loaded(tmp_path):
    path = tmp_path / "shard_000000.npz"
    np.savez(path, format=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ShardError, match="damaged"):
        read_shard(path)


def test_an_interrupted_write_leaves_the_old_shard(tmp_path, monkeypatch):
    path = tmp_path / "shard_000000.npz"
    write_shard(path, [labels_of(0)])

    def fail(file, **columns):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", fail)
    with pytest.raises(OSError, match="No space"):
        write_shard(path, [labels_of(1)])
    assert [labels.index for labels in read_shard(path)] == [0]
    assert list(tmp_path.iterdir()) == [path]


def test_an_empty_folder_or_shard_is_an_error(tmp_path):
    with pytest.raises(ShardError, match="holds no"):
        list(load_shards(tmp_path))
    with pytest.raises(ShardError, match="at least one scene"):
        write_shard(tmp_path / "shard_000000.npz", [])


def test_merging_sorts_scenes_into_few_shards_below_the_limit(tmp_path):
    for index in (7, 2, 9, 4):
        write_shard(
            next_shard_path(tmp_path), [labels_of(index), labels_of(index + 10)]
        )
    paths = merge_shards(tmp_path, tmp_path / "merged")
    assert paths == shard_paths(tmp_path / "merged")
    assert len(paths) == 1
    merged = list(load_shards(tmp_path / "merged"))
    assert [labels.index for labels in merged] == [2, 4, 7, 9, 12, 14, 17, 19]
    same(merged[0], labels_of(2))
    limit = 12_000
    split = merge_shards(tmp_path, tmp_path / "split", max_bytes=limit)
    assert len(split) > 1
    assert max(path.stat().st_size for path in split) <= limit
