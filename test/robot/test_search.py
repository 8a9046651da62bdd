# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from neugrasp_ros.geometry.transform import flip_gripper, make_transform
from neugrasp_ros.robot.model import tcp_from_gripper
from neugrasp_ros.robot.obstacles import make_obstacles
from neugrasp_ros.robot.search import (
    DONE,
    HITS_ITSELF,
    HITS_SCENE,
    NO_WAY,
    UNSOLVED,
    Question,
    no_answers,
    search_ways,
)
from neugrasp_ros.robot.ways import WayProblem, make_way

LEFT, RIGHT = "arm_left_torso", "arm_right_torso"
DOWN = np.diag([-1.0, 1.0, -1.0])  # approach downwards, closing along y
STEPS = np.array([0.05, 0.10])  # [m]
NEAR = make_transform(DOWN, np.array([0.6, 0.2, 0.80]))
FAR = make_transform(DOWN, np.array([4.0, 0.2, 0.80]))
INSIDE = make_transform(  # the torso, from the front
    np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
    np.array([[0.05, 0.0, z] for z in np.linspace(0.75, 0.95, 8)]),
)


def search(reach, grasps, arms=(LEFT,), points=None, **options):
    """Search straight back and up from grasps (N, 4, 4) with some arms."""
    grasps = np.asarray(grasps)
    start, tips = reach.robot.home, grasps[:, None, :3, 3]
    parts = []
    for name, arm in reach.arms.items():
        problem = WayProblem(
            reach.collisions.scope(name), arm.indices, arm.problem, 0.5, 0.1
        )
        way = make_way(len(STEPS), len(STEPS), len(arm.lower), len(start))
        parts.append(arm.search(problem, way, start[arm.indices]))
    question = Question(
        targets=tcp_from_gripper(np.concatenate([grasps, flip_gripper(grasps)])),
        behind=tips - STEPS[:, None] * grasps[:, None, :3, 2],
        above=tips + STEPS[:, None] * [0, 0, 1],
        begins=np.tile(start, (len(reach.arms), len(grasps), 1)),
        asked=np.array([name in arms for name in reach.arms]),
        **{
            "first_starts": 1,
            "most_starts": 3,
            "retries": 5,
            "travel_weight": 0.0,
            "min_manipulability": 0.0,
            **options,
        },
    )
    answers = no_answers(len(grasps), len(STEPS), len(STEPS), 8)
    world = reach.collisions.world(make_obstacles(points))
    search_ways(world, tuple(parts), question, answers)
    return answers


def arms_of(reach, answers):
    return [list(reach.arms)[branch // 2] for branch in answers.branches]


def test_each_grasp_tells_how_far_it_got(reach):
    palm = np.array([[0.034, 0.052, -0.06, 1.0]]) @ NEAR.T
    assert search(reach, [NEAR, FAR]).progress.tolist() == [DONE, UNSOLVED]
    inside = search(reach, INSIDE, arms=(LEFT, RIGHT))
    assert inside.progress.max() == HITS_ITSELF
    at_palm, over_it = palm[:, :3], palm[:, :3] + [0, 0, 0.10]
    assert search(reach, [NEAR], points=at_palm).progress[0] == HITS_SCENE
    assert search(reach, [NEAR], points=over_it).progress[0] == NO_WAY


def test_only_what_is_done_has_a_way(reach):
    answers = search(reach, [FAR, NEAR])
    assert answers.branches[0] == -1
    for values in (answers.q, answers.manipulability, answers.retreats, answers.lifts):
        assert np.isnan(values[0]).all()
        assert np.isfinite(values[1]).all()


def test_a_way_begins_at_the_grasp_and_goes_back_and_up(reach, left):
    answers = search(reach, [NEAR])
    wanted = flip_gripper(NEAR) if answers.branches[0] % 2 else NEAR
    at = left.forward(answers.q)[0]
    assert at == pytest.approx(wanted, abs=2e-3)
    heights = np.array([[0.0, 0.0, step] for step in STEPS])
    for values in (answers.retreats[0], answers.lifts[0]):
        moved = left.forward(values)[:, :3, 3] - NEAR[:3, 3]
        assert moved == pytest.approx(heights, abs=1e-3)


def test_the_arm_on_the_side_of_the_grasp_is_the_more_nimble(reach):
    mirrored = make_transform(DOWN, NEAR[:3, 3] * [1, -1, 1])
    answers = search(reach, [NEAR, mirrored], arms=(LEFT, RIGHT))
    assert arms_of(reach, answers) == [LEFT, RIGHT]


def test_an_arm_that_is_not_asked_does_nothing(reach):
    mirrored = make_transform(DOWN, NEAR[:3, 3] * [1, -1, 1])
    for name, grasp in ((LEFT, NEAR), (RIGHT, mirrored)):
        answers = search(reach, [grasp, NEAR, mirrored], arms=(name,))
        assert answers.progress[0] == DONE
        done = answers.progress == DONE
        assert set(np.array(arms_of(reach, answers))[done]) == {name}
    assert search(reach, [NEAR], arms=()).progress[0] == UNSOLVED


def test_travel_counts_against_a_solution(reach):
    """Where time is all that matters, the chosen posture is no farther away."""
    home = reach.robot.home[reach.arms[LEFT].indices]
    speeds = reach.robot.limits.velocity[reach.arms[LEFT].indices]

    def seconds(weight):
        q = search(reach, [NEAR], travel_weight=weight).q[0]
        return np.max(np.abs(q - home) / speeds)

    assert seconds(1e3) <= seconds(0.0)


def test_a_posture_that_is_not_nimble_enough_does_not_count(reach):
    share = search(reach, [NEAR]).manipulability[0]
    assert 0.0 < share <= 1.0
    assert search(reach, [NEAR], min_manipulability=1.0).progress[0] == UNSOLVED


def test_other_solutions_are_looked_for(reach):
    """An obstacle at the elbow of the first solution leaves another one."""
    answers = search(reach, [NEAR])
    q = reach.robot.home.copy()
    q[reach.arms[LEFT].indices] = answers.q[0]
    elbow = reach.robot.frame_pose(q, "arm_left_4_link")[None, :3, 3]
    given_up = search(reach, [NEAR], points=elbow, retries=0)
    assert search(reach, [NEAR], points=elbow).progress[0] >= given_up.progress[0]
    retried = search(reach, [NEAR], points=elbow, retries=12)
    assert retried.progress[0] == DONE
    assert not np.allclose(retried.q, answers.q)
