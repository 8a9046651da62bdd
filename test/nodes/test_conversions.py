# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("neugrasp_msgs")

from geometry_msgs.msg import Pose  # noqa: E402
from neugrasp_msgs.msg import Grasp, GraspArray, TsdfVolume  # noqa: E402

from neugrasp_ros.errors import ConfigError, ShapeError  # noqa: E402
from neugrasp_ros.fusion.tsdf import TsdfVolume as Volume  # noqa: E402
from neugrasp_ros.geometry.transform import (  # noqa: E402
    make_transform,
    random_rotation,
    translation,
)
from neugrasp_ros.grasp.types import GraspSet  # noqa: E402
from neugrasp_ros.nodes.compat.images import to_bytes  # noqa: E402
from neugrasp_ros.nodes.conversions import (  # noqa: E402
    from_grasp_array,
    from_pose,
    from_poses,
    from_stamp,
    from_tsdf,
    only,
    to_best_pose,
    to_grasp_array,
    to_pose,
    to_pose_array,
    to_stamp,
    to_tsdf,
)
from neugrasp_ros.nodes.grasp_list import GraspInfo, GraspList, Reach  # noqa: E402
from neugrasp_ros.nodes.scene_view import SceneView  # noqa: E402


def filled(axes: int = 0) -> GraspList:
    rng = np.random.default_rng(0)
    rotations = np.array([random_rotation(rng) for _ in range(3)])
    grasps = GraspSet(
        make_transform(rotations, rng.normal(size=(3, 3))),
        np.array([0.02, 0.05, 0.085]),
        np.array([0.9, 0.5, np.nan]),
        rng.random((3, 2)),
        np.array([4, -1, 2], dtype=np.int32),
        ("a", "b", "c"),
    )
    info = GraspInfo(
        frame_id="base", stamp=12_000_000_034, axes=axes, stage=2, gripper="panda",
        tcp_frame="tcp", query="cut", labels=("cut", "pour"), joint_names=("j1", "j2"),
        revision=77,
    )  # fmt: skip
    reach = Reach(
        codes=np.array([1, 2, 3], dtype=np.uint8),
        arms=("left", "right", ""),
        manipulability=np.array([0.25, 0.5, np.nan]),
        joints=(np.array([1.0, 2.0]), np.zeros(0), np.zeros(0)),
    )
    return GraspList(
        info, grasps, np.array([0.5, 0.25, np.nan]), rng.random((3, 2, 3)), reach
    )


@pytest.mark.parametrize("axes", [0, 1, 2])
def test_grasps_round_trip(axes):
    grasps = filled(axes)
    back = from_grasp_array(to_grasp_array(grasps))
    assert back.info == grasps.info
    np.testing.assert_allclose(back.grasps.poses, grasps.grasps.poses, atol=1e-9)
    for name in ("widths", "quality", "affordances", "object_ids"):
        np.testing.assert_allclose(
            getattr(back.grasps, name), getattr(grasps.grasps, name), atol=1e-6
        )
    assert back.grasps.ids == grasps.grasps.ids
    np.testing.assert_allclose(back.affordance, grasps.affordance, atol=1e-6)
    np.testing.assert_allclose(back.contacts, grasps.contacts)
    np.testing.assert_array_equal(back.reach.codes, grasps.reach.codes)
    np.testing.assert_allclose(back.reach.manipulability, grasps.reach.manipulability)
    assert back.reach.arms == grasps.reach.arms
    np.testing.assert_allclose(back.reach.joints[0], grasps.reach.joints[0])


def filled_fields(message) -> set[str]:
    blank = type(message)()
    names = message.get_fields_and_field_types()
    return {n for n in names if repr(getattr(message, n)) != repr(getattr(blank, n))}


def test_every_field_of_every_message_is_filled():
    grasps = filled(axes=1)
    array = to_grasp_array(grasps)
    assert filled_fields(array) == set(GraspArray.get_fields_and_field_types())
    assert filled_fields(array.grasps[0]) == set(Grasp.get_fields_and_field_types())
    tsdf = to_tsdf(replace(view(), T_frame_task=translation(0.5, 0.0, 0.7)))
    unset = {"encoding"}  # 32FC1 is zero
    assert filled_fields(tsdf) == set(TsdfVolume.get_fields_and_field_types()) - unset


def test_what_is_not_computed_says_so():
    bare = GraspList(
        GraspInfo(frame_id="task"), GraspSet(np.eye(4)[None], np.array([0.04]))
    )
    grasp = to_grasp_array(bare).grasps[0]
    assert np.isnan([grasp.quality, grasp.affordance, grasp.manipulability]).all()
    assert (grasp.object_id, grasp.reachability, grasp.arm) == (-1, 0, "")
    assert not grasp.affordance_scores and not grasp.contacts
    assert not grasp.joint_positions
    back = from_grasp_array(to_grasp_array(bare))
    assert back.contacts.shape == (1, 2, 3) and np.isnan(back.contacts).all()
    assert np.isnan(back.affordance).all()


def test_contacts_may_be_known_of_some_grasps_only():
    grasps = filled()
    contacts = grasps.contacts.copy()
    contacts[1] = np.nan
    array = to_grasp_array(replace(grasps, contacts=contacts))
    assert [len(grasp.contacts) for grasp in array.grasps] == [2, 0, 2]
    np.testing.assert_array_equal(from_grasp_array(array).contacts, contacts)


def test_a_foreign_array_with_little_in_it_is_taken():
    array = GraspArray(axes=2, grasps=[Grasp(width=0.05), Grasp(width=0.06)])
    array.header.frame_id = "camera"
    grasps = from_grasp_array(array)
    assert grasps.grasps.ids == ("g0000", "g0001")
    np.testing.assert_allclose(grasps.grasps.poses[0][:3, 1], [1, 0, 0])


def broken(change) -> GraspArray:
    array = to_grasp_array(filled())
    change(array)
    return array


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda a: setattr(a.header, "frame_id", ""), "frame_id is empty"),
        (lambda a: setattr(a, "axes", 9), "axes must be 0, 1 or 2"),
        (lambda a: setattr(a.grasps[0], "width", float("nan")), "width is negative"),
        (lambda a: setattr(a.grasps[0], "width", -0.1), "width is negative"),
        (lambda a: setattr(a.grasps[1], "id", "a"), "an id comes twice"),
        (
            lambda a: setattr(a.grasps[0].pose.position, "x", float("inf")),
            "not finite",
        ),
        (
            lambda a: (
                setattr(a.grasps[0].pose, "orientation", Pose().orientation)
                or setattr(a.grasps[0].pose.orientation, "w", 0.0)
            ),
            "quaternion has length 0",
        ),
        (
            lambda a: setattr(a.grasps[0], "affordance_scores", [0.1]),
            "differ in length",
        ),
    ],
)
def test_a_broken_array_is_refused(change, sentence):
    with pytest.raises(ConfigError, match=sentence):
        from_grasp_array(broken(change))


def test_lists_move_between_frames_and_keep_their_rows():
    grasps = filled()
    T = translation(1.0, 0.0, 0.0)
    moved = grasps.moved(T, "map")
    assert moved.info.frame_id == "map"
    np.testing.assert_allclose(moved.grasps.poses, T @ grasps.grasps.poses)
    np.testing.assert_allclose(moved.contacts, grasps.contacts + [1.0, 0.0, 0.0])
    taken = grasps.take(np.array([2, 0]))
    assert taken.grasps.ids == ("c", "a") and taken.reach.arms == ("", "left")
    np.testing.assert_array_equal(taken.contacts, grasps.contacts[[2, 0]])
    assert len(grasps.take(np.array([False, True, False]))) == 1


def test_views_of_the_same_array_for_rviz():
    array = to_grasp_array(filled())
    assert to_pose_array(array).poses == [g.pose for g in array.grasps]
    best = to_best_pose(array)
    assert (best.header, best.pose) == (array.header, array.grasps[0].pose)


def test_poses_and_stamps_round_trip():
    T = make_transform(
        random_rotation(np.random.default_rng(3)), np.array([1.0, 2.0, 3.0])
    )
    np.testing.assert_allclose(from_pose(to_pose(T)), T, atol=1e-12)
    assert from_poses([]).shape == (0, 4, 4)
    assert from_stamp(to_stamp(5_000_000_006)) == 5_000_000_006


def view() -> SceneView:
    rng = np.random.default_rng(5)
    distances = rng.uniform(-1, 1, (2, 3, 4)).astype(np.float32)
    distances[0, 0, 0] = np.nan
    weights = rng.integers(1, 255, (2, 3, 4)).astype(np.uint8)
    volume = Volume(distances, weights, 0.0046875, 0.01875, 6)
    pose = translation(0.5, -0.15, 0.7)
    return SceneView(
        volume=volume,
        T_frame_task=pose,
        frame_id="base",
        stamp=9_000_000_001,
        revision=8,
    )


def test_a_volume_round_trips_bit_for_bit():
    scene = view()
    back = from_tsdf(to_tsdf(scene))
    np.testing.assert_array_equal(back.volume.distances, scene.volume.distances)
    np.testing.assert_array_equal(back.volume.weights, scene.volume.weights)
    assert back.volume.voxel_size == pytest.approx(scene.volume.voxel_size, rel=1e-6)
    assert back.volume.view_count == 6
    assert (back.frame_id, back.stamp, back.revision) == ("base", 9_000_000_001, 8)
    np.testing.assert_allclose(back.T_frame_task, scene.T_frame_task)


def test_the_index_of_a_voxel_is_the_documented_one():
    message = to_tsdf(view())
    flat = np.frombuffer(message.distances, "<f4")
    x, y, z = 1, 2, 3
    index = (x * message.size_y + y) * message.size_z + z
    assert flat[index] == view().volume.distances[x, y, z]


def test_half_floats_are_read_and_bad_volumes_refused():
    message = to_tsdf(view())
    half = view().volume.distances.astype("<f2")
    message.encoding, message.distances = TsdfVolume.ENCODING_16FC1, to_bytes(half)
    np.testing.assert_allclose(from_tsdf(message).volume.distances, half)
    message.size_x = 7
    with pytest.raises(ShapeError, match="distances"):
        from_tsdf(message)
    message.encoding = 9
    with pytest.raises(ConfigError, match="encoding 9"):
        from_tsdf(message)


def test_one_grasp_keeps_what_is_said_of_all():
    array = GraspArray(axes=1, gripper="g", tcp_frame="t", scene_revision=7)
    array.joint_names = ["a", "b"]
    array.header.frame_id = "base"
    array.grasps = [Grasp(width=0.05), Grasp(width=0.06)]
    alone = only(array, array.grasps[1])
    assert [grasp.width for grasp in alone.grasps] == [0.06]
    alone.grasps = array.grasps
    assert alone == array
