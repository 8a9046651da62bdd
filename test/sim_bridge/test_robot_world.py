# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.errors import SimulationError, UnknownNameError
from neugrasp_ros.geometry.transform import make_transform
from neugrasp_ros.robot.kinematics import ArmKinematics
from sim_bridge import robot_world

pytestmark = pytest.mark.filterwarnings("ignore:Gimbal lock")

DOWN = np.diag([1.0, -1.0, -1.0])
ARM = "arm_left_controller"


@pytest.fixture(scope="module")
def kinematics(tiago):
    return ArmKinematics(tiago, "arm_left_torso")


def posture(tiago, kinematics, height, near=None):
    """Left hand over, or in, the table, pointing down."""
    T = make_transform(DOWN, np.array([0.5, 0.15, height]))
    found = kinematics.solve(T[None], near=near)
    assert found.reached[0]
    q = tiago.home.copy()
    q[kinematics.indices] = found.q[0]
    return q


def test_the_same_seed_gives_the_same_scene_and_stance(cell):
    names = cell.spawn("shelf", 4, 3)
    before = cell.snapshot
    cell.spawn("cupboard", 5, 3)
    assert not np.allclose(cell.snapshot.robot.stance.q, before.robot.stance.q)
    assert cell.spawn("shelf", 4, 3) == names
    np.testing.assert_array_equal(cell.snapshot.robot.stance.q, before.robot.stance.q)
    np.testing.assert_allclose(cell.snapshot.poses, before.poses, atol=1e-6)


def test_in_lockstep_time_goes_on_only_when_told(cell):
    cell.spawn("table", 1, 1)
    start = cell.now
    cell.advance(0.25)
    assert cell.now - start == pytest.approx(0.25)
    asked = []
    cell.advance(0.1, lambda: asked.append(cell.now) or len(asked) == 3)
    assert cell.now - start == pytest.approx(0.55)


def test_round_objects_do_not_roll_on_for_ever(cell):
    cell.spawn("table:pile", 3, 5)
    assert any("dumbbell" in name for name in cell.snapshot.names)
    cell.advance(0.5)
    before = cell.snapshot.poses[:, :3, 3]
    cell.advance(2.0)
    gone = np.linalg.norm(cell.snapshot.poses[:, :3, 3] - before, axis=1)
    assert gone.max() < 0.003


def test_unknown_furniture_and_a_free_hand_are_refused(cell):
    with pytest.raises(UnknownNameError, match="known: cupboard, shelf, table"):
        cell.spawn("bed:pile", 0, 1)
    with pytest.raises(SimulationError, match="execute_grasp"):
        cell.try_grasp(np.eye(4), 0.08, 0.1)


def test_a_hand_pressed_onto_the_table_is_felt(cell, tiago, kinematics):
    cell.spawn("table", 0, 0)
    above = posture(tiago, kinematics, 0.74)
    below = posture(tiago, kinematics, 0.66, near=above[kinematics.indices])
    cell.do(lambda: cell._body.reset(above)).result()
    for name, joints in cell.controllers.items():
        rows = [tiago.joint_names.index(j) for j in joints if j in tiago.joint_names]
        if rows:
            cell.drives[name].hold(above[rows])
    cell.advance(0.3)
    assert cell.largest_touch.force == 0.0
    for name in (ARM, "torso_controller"):
        drive = cell.drives[name]
        rows = [tiago.joint_names.index(j) for j in drive.names]
        drive.start(drive.read(np.array([1.0]), below[rows][None]), cell.now)
    cell.advance(1.5)
    touch = cell.largest_touch
    assert touch.force > 5.0 and touch.link.startswith("gripper_left")


def test_set_points_beyond_the_limits_are_noticed(cell):
    cell.spawn("table", 0, 0)
    cell.advance(0.1)
    assert cell.limit_use.samples == 0
    drive = cell.drives["head_controller"]
    goal = drive.target + [0.3, 0.0]
    drive.start(drive.read(np.array([2.0]), goal[None]), cell.now)
    cell.advance(2.1)
    assert 0.0 < cell.limit_use.velocity < 1.0 and cell.limit_use.samples > 200
    assert cell.limit_use.position == 0.0
    drive.start(drive.read(np.array([0.05]), goal[None] - [0.6, 0.0]), cell.now)
    cell.advance(0.1)
    assert cell.limit_use.velocity > 1.0 and cell.limit_use.jerk > 1.0


def test_after_a_scene_that_could_not_be_built_the_world_lives_on(cell, monkeypatch):
    cell.spawn("table", 0, 0)
    before = cell.snapshot.robot

    def refuse(furniture, seed):
        raise SimulationError("no place to stand")

    with monkeypatch.context() as broken:
        broken.setattr(cell, "_stand", refuse)
        drive = cell.drives["head_controller"]
        with pytest.raises(SimulationError, match="no place"):
            cell.spawn("table", 1, 0)
    assert cell.drives["head_controller"] is not drive, "who waits for it must know"
    cell.advance(0.1)
    cell.do(cell._rests).result()  # as the physics thread asks in real time
    np.testing.assert_array_equal(cell.snapshot.robot.q, before.q)
    cell.spawn("table", 1, 0)
    cell.advance(0.1)
    assert cell.ended == ""
    assert not np.allclose(cell.snapshot.robot.stance.q, before.stance.q)


def test_after_a_scene_that_broke_half_way_the_robot_is_back(cell, monkeypatch):
    cell.spawn("shelf", 0, 0)
    before = cell.snapshot.robot
    build_scene = robot_world.build_scene

    def build(world, *scene, seed, **options):
        if seed == 9:
            world.reset()
            raise ValueError("broken mesh")
        return build_scene(world, *scene, seed=seed, **options)

    monkeypatch.setattr(robot_world, "build_scene", build)
    with pytest.raises(ValueError, match="broken mesh"):
        cell.spawn("table", 9, 0)
    robot = cell.snapshot.robot
    np.testing.assert_array_equal(robot.stance.q, before.stance.q)
    assert [b.name for b in robot.blocks] == [b.name for b in before.blocks]
    drive = cell.drives["head_controller"]
    goal = drive.target + [0.2, 0.0]
    drive.start(drive.read(np.array([1.0]), goal[None]), cell.now)
    cell.advance(1.2)
    assert cell.following("head_controller")[0] == pytest.approx(goal, abs=0.02)


def test_a_world_without_a_scene_has_no_places_to_compare(cell, monkeypatch):
    cell.spawn("table", 0, 0)
    assert cell.do(cell._places).result() is not None
    empty = cell.snapshot._replace(robot=None)
    monkeypatch.setattr(cell, "snapshot", empty)
    assert cell.do(cell._places).result() is None
