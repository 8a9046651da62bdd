# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from sim_shapes import box_model, model_of, standing

from neugrasp_ros.errors import SimulationError
from neugrasp_ros.geometry.transform import (
    make_transform,
    random_rotation,
    translation,
)
from sim_bridge.objects.model import Part
from sim_bridge.world import TABLE_HEIGHT, World


def test_the_table_top_is_where_the_benchmark_has_it(make_world):
    world = make_world()
    lower, upper = world.bounds(world.table)
    np.testing.assert_allclose(upper, [0.75, 0.75, 0.05], atol=2e-3)
    np.testing.assert_allclose(lower, [-0.45, -0.45, 0.038], atol=2e-3)


def test_a_dropped_box_comes_to_rest_on_the_table(make_world):
    world = make_world()
    body = world.load_object(box_model(0.02, 0.03, 0.01), standing(0.03))
    assert world.wait_for_rest()
    assert abs(world.pose(body)[2, 3] - (TABLE_HEIGHT + 0.01)) < 1e-3
    assert np.linalg.norm(world.velocity(body)) <= 0.01


@pytest.mark.parametrize(
    ("part", "height"),
    [
        (Part("sphere", (0.02,)), 0.02),
        (Part("cylinder", (0.02, 0.05)), 0.025),
        (Part("capsule", (0.02, 0.05)), 0.045),
        (Part("hull", vertices=0.02 * np.vstack([np.eye(3), -np.eye(3)])), 0.02),
    ],
)
def test_every_kind_of_part_reaches_as_far_down_as_its_mesh(make_world, part, height):
    world = make_world()
    body = world.load_object(model_of(part), standing(height + 0.05))
    world.step()
    lower, _ = world.bounds(body)
    assert abs(lower[2] - (TABLE_HEIGHT + 0.05)) < 4e-3


def test_a_bowl_of_hulls_keeps_its_cavity(make_world):
    world = make_world()
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    walls = [
        Part("hull", vertices=corners * [0.005, 0.05, 0.02], pose=translation(x, 0, 0))
        for x in (-0.045, 0.045)
    ]
    world.load_object(model_of(*walls), standing(0.02))
    ball = world.load_object(model_of(Part("sphere", (0.01,))), standing(0.012))
    world.step()
    assert world.contacts(ball, world.object_ids[0]) == []


def test_a_pose_is_that_of_the_object_frame_whatever_the_centre_of_mass(make_world):
    world = make_world()
    rng = np.random.default_rng(3)
    model = box_model(0.02, 0.02, 0.02)
    object.__setattr__(model, "center_of_mass", np.array([0.01, -0.005, 0.003]))
    pose = make_transform(random_rotation(rng), np.array([0.1, 0.2, 0.3]))
    body = world.load_object(model, pose)
    np.testing.assert_allclose(world.pose(body), pose, atol=1e-9)
    other = make_transform(random_rotation(rng), np.array([0.2, 0.1, 0.2]))
    world.set_pose(body, other)
    np.testing.assert_allclose(world.pose(body), other, atol=1e-9)


def test_a_restored_state_goes_on_exactly_as_before(make_world):
    world = make_world()
    body = world.load_object(box_model(0.02, 0.03, 0.01), standing(0.05))
    world.step(20)
    with world.saved_state() as state:
        outcomes = []
        for _ in range(2):
            world.restore(state)
            world.step(60)
            outcomes.append(world.pose(body))
    np.testing.assert_array_equal(*outcomes)


def test_restoring_with_other_bodies_is_an_error(make_world):
    world = make_world()
    world.load_object(box_model(0.02, 0.02, 0.02), standing(0.02))
    with world.saved_state() as state:
        world.load_object(box_model(0.02, 0.02, 0.02), standing(0.02, x=0.25))
        with pytest.raises(SimulationError, match="other bodies"):
            world.restore(state)


def test_objects_outside_the_workspace_are_cleared_and_reported(make_world):
    world = make_world()
    inside = world.load_object(box_model(0.02, 0.02, 0.02), standing(0.02))
    outside = world.load_object(box_model(0.02, 0.02, 0.02), standing(0.02, x=0.35))
    assert world.clear_outside() == (outside,)
    assert world.object_ids == (inside,)


def test_sleeping_objects_stay_put_until_they_are_touched(make_world):
    world = make_world(sleeping=True)
    body = world.load_object(box_model(0.02, 0.02, 0.02), standing(0.02))
    world.wait_for_rest()
    world.put_to_sleep()
    before = world.pose(body)
    world.step(20)
    np.testing.assert_allclose(world.pose(body), before, atol=1e-5)
    other = world.load_object(box_model(0.02, 0.02, 0.02), standing(0.10))
    world.step(60)
    assert world.contacts(body, other)


def test_a_detection_finds_contacts_without_moving_anything(make_world):
    world = make_world()
    body = world.load_object(box_model(0.02, 0.02, 0.02), standing(0.019))
    assert not world.has_contact(body)
    world.detect_collisions()
    assert world.has_contact(body)
    np.testing.assert_allclose(world.pose(body), standing(0.019), atol=1e-12)


def test_a_refused_file_is_an_error_that_names_it(make_world, tmp_path, capfd):
    world = make_world()
    with pytest.raises(SimulationError, match="missing.urdf"):
        world.load_urdf(
            tmp_path / "missing.urdf", position=[0, 0, 0], quaternion=[0, 0, 0, 1]
        )


def test_closing_twice_is_harmless_and_removes_temporary_files():
    with World() as world:
        path = world.scratch_path("note.txt")
        path.write_text("gone when the world is")
    world.close()
    assert not path.exists()
    assert not path.parent.exists()
