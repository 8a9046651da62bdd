# SPDX-License-Identifier: Apache-2.0
import pickle

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.errors import SceneFileError  # noqa: E402
from neugrasp_ros.fusion.tsdf import TsdfVolume  # noqa: E402
from neugrasp_ros.nodes.scene_file import (  # noqa: E402
    SavedScene,
    read_scene,
    write_scene,
)
from neugrasp_ros.nodes.settings import WorkspaceConfig  # noqa: E402


def scene() -> SavedScene:
    rng = np.random.default_rng(0)
    distances = rng.uniform(-1, 1, (15, 10, 20)).astype(np.float32)
    distances[0, 0, :5] = np.nan
    weights = rng.integers(0, 255, distances.shape, dtype=np.uint8)
    workspace = WorkspaceConfig(
        frame="map", origin=(0.1, -2.0, 0.7), rpy=(0.0, 0.1, -3.0), size=(0.3, 0.2, 0.4)
    )
    return SavedScene(TsdfVolume(distances, weights, 0.02, 0.08, 3), workspace, 10**18)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "scene.npz"
    write_scene(path, scene())
    return path


def test_what_is_written_is_read(path):
    there, here = read_scene(path), scene()
    assert there.workspace == here.workspace and there.stamp == here.stamp
    for name in ("distances", "weights", "voxel_size", "truncation", "view_count"):
        left, right = getattr(there.volume, name), getattr(here.volume, name)
        np.testing.assert_array_equal(left, right)
        assert np.asarray(left).dtype == np.asarray(right).dtype


def test_the_folder_holds_the_file_and_nothing_else(path):
    write_scene(path, scene())
    assert [p.name for p in path.parent.iterdir()] == ["scene.npz"]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("scene.pkl", "a scene file ends in .npz"),
        ("folder.npz", "is a folder, expected a file"),
    ],
)
def test_a_bad_path_is_not_written_to(tmp_path, name, sentence):
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(SceneFileError) as caught:
        write_scene(tmp_path / name, scene())
    assert str(caught.value) == f"{tmp_path / name}: {sentence}"


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(SceneFileError, match=f"there is no folder {tmp_path}/none$"):
        write_scene(tmp_path / "none" / "scene.npz", scene())


def test_whoever_may_read_our_files_may_read_a_scene(path):
    other = path.with_name("other")
    other.touch()
    assert path.stat().st_mode == other.stat().st_mode


def test_a_missing_file_says_so(tmp_path):
    with pytest.raises(SceneFileError, match="there is no such file; save a scene"):
        read_scene(tmp_path / "scene.npz")


@pytest.mark.parametrize("keep", [0, 100, -300])
def test_a_torn_file_is_refused(path, keep):
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(SceneFileError, match="is no scene file"):
        read_scene(path)


def test_a_single_array_is_no_scene(path):
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(SceneFileError, match="a single array"):
        read_scene(path)


class Trap:
    """Would announce itself if it were unpickled."""

    def __reduce__(self):
        return pytest.fail, ("a pickle was loaded",)


def test_a_pickle_is_never_loaded(path):
    path.write_bytes(pickle.dumps(Trap()))
    with pytest.raises(SceneFileError, match="is no scene file"):
        read_scene(path)
    np.savez(path, frame=np.array([Trap()], dtype=object))
    with pytest.raises(SceneFileError, match="is no scene file"):
        read_scene(path)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"weights": None}, "it lacks weights"),
        ({"format": 9}, "is of format 9, this version reads 1"),
        ({"distances": np.zeros(4)}, "distances is float64 with 1 dimensions"),
        ({"distances": np.full((15, 10, 20), 2.0)}, "distances must be within -1..1"),
        ({"weights": np.zeros((2, 2, 2), np.uint8)}, "weights: expected shape"),
        ({"voxel_size": -0.1}, "lengths must be within 0..1 m"),
        ({"truncation": np.nan}, "lengths must be within 0..1 m"),
        ({"view_count": 0}, "holds a scene without any view"),
        ({"origin": np.zeros(2)}, "expected x, y, z"),
        ({"origin": np.full(3, np.inf)}, "workspace.origin must be within 100.0 m"),
        ({"frame": ""}, "workspace.frame must not be empty"),
        ({"size": np.full(3, 0.5)}, "do not fill"),
    ],
)
def test_a_file_with_a_wrong_value_names_it(path, changes, sentence):
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files} | changes
    np.savez(path, **{name: v for name, v in arrays.items() if v is not None})
    with pytest.raises(SceneFileError) as caught:
        read_scene(path)
    assert sentence in str(caught.value)
