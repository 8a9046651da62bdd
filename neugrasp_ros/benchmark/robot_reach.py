# SPDX-License-Identifier: Apache-2.0
"""How fast, complete and true the reachability check is, on task-like grasps."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from neugrasp_ros.geometry.transform import flip_gripper, invert, make_transform
from neugrasp_ros.robot.model import RobotModel
from neugrasp_ros.robot.obstacles import Obstacles, SolidBox, make_obstacles
from neugrasp_ros.robot.postures import PER_CELL
from neugrasp_ros.robot.reachability import ReachabilityChecker, ReachResult
from neugrasp_ros.robot.settings import IkConfig, ReachabilityConfig
from sim_bridge.robot_body import RobotBody
from sim_bridge.robot_cell import robot_setup
from sim_bridge.world import World

FloatArray = NDArray[np.float64]

GRASPS = 200
TOP = 0.70  # [m], of the table
REGION = (np.array([0.4, -0.4, TOP + 0.02]), np.array([0.9, 0.4, 1.0]))  # [m]
FORWARD = np.array([0.6, 0.0, -0.8])  # approaches lie about it, within
CONE = float(np.deg2rad(70.0))
ITEMS, ITEM_POINTS = 5, 4000  # boxes on the table, points seen of each
SLOW_STARTS = 128  # of every arm and side; what is not stored is random
TABLE = SolidBox(
    make_transform(np.eye(3), np.array([0.63, 0.0, TOP - 0.015])),
    np.array([0.6, 0.8, 0.03]),
)
EVERY = 7  # postures between two that are looked at for links in each other
DEEP = 0.002  # [m]; less is the difference of two checkers' hulls


def draw_grasps(rng: np.random.Generator, count: int) -> FloatArray:
    """Draw gripper poses over a table, shape (N, 4, 4), as a sampler gives them."""
    poses: list[FloatArray] = []
    while len(poses) < count:
        z = rng.normal(size=3)
        z /= np.linalg.norm(z)
        if z @ FORWARD < np.cos(CONE):
            continue
        x = np.cross(rng.normal(size=3), z)
        x /= np.linalg.norm(x)
        rotation = np.stack([x, np.cross(z, x), z], axis=1)
        poses.append(make_transform(rotation, rng.uniform(*REGION)))
    return np.array(poses)


def draw_scene(rng: np.random.Generator) -> Obstacles:
    """Draw a table with boxes whose surface was seen."""
    seen = []
    for _ in range(ITEMS):
        half = rng.uniform(0.02, 0.05, 3)
        center = np.array([*rng.uniform([0.45, -0.15], [0.65, 0.15]), TOP + half[2]])
        points = rng.uniform(-1, 1, (ITEM_POINTS, 3))
        face = rng.integers(0, 3, ITEM_POINTS)
        rows = np.arange(ITEM_POINTS)
        points[rows, face] = np.sign(points[rows, face])
        seen.append(center + points * half)
    return make_obstacles(np.concatenate(seen), boxes=[TABLE])


def slow_reference(robot: RobotModel) -> ReachabilityChecker:
    """Return a checker that gives no grasp up before 128 starts a branch failed."""
    return ReachabilityChecker(
        robot,
        ReachabilityConfig(
            first_starts=SLOW_STARTS, most_starts=SLOW_STARTS, retries=SLOW_STARTS
        ),
        IkConfig(restarts=SLOW_STARTS, random_starts=SLOW_STARTS, reach_map=False),
    )


def measure(robot: RobotModel, sets: int, slow_sets: int, seed: int) -> dict[str, Any]:
    """Return times, recall and truth.

    Args:
        robot: The robot.
        sets: Sets of grasps, each with a scene of its own.
        slow_sets: How many of them the slow reference answers, too.
        seed: Of grasps and scenes.
    """
    rng = np.random.default_rng(seed)
    fast = ReachabilityChecker(robot)
    slow = slow_reference(robot)
    questions = [(draw_grasps(rng, GRASPS), draw_scene(rng)) for _ in range(sets)]
    fast.check(questions[0][0][:20], obstacles=questions[0][1])  # compiles
    answers, milliseconds = [], []
    for grasps, scene in questions:
        begin = time.process_time()
        answers.append(fast.check(grasps, obstacles=scene))
        milliseconds.append(1e3 * (time.process_time() - begin))
    both, known = 0, 0
    for (grasps, scene), answer in list(zip(questions, answers, strict=True))[
        :slow_sets
    ]:
        reference = slow.check(grasps, obstacles=scene).reachable
        known += int(reference.sum())
        both += int((reference & answer.reachable).sum())
    reachable = sum(int(a.reachable.sum()) for a in answers)
    return {
        "sets": sets,
        "grasps_per_set": GRASPS,
        "cpu_milliseconds": {
            "median": float(np.median(milliseconds)),
            "p90": float(np.quantile(milliseconds, 0.9)),
        },
        "reachable": reachable,
        "recall_percent": 100.0 * both / known if known else None,
        "recall_of": known,
        "reference_starts": SLOW_STARTS,
        "reference": f"from {SLOW_STARTS} starts for each arm and side of the hand, "
        f"the stored postures near the wrist's place (up to {PER_CELL}) and random "
        "ones, without the reach map; every solution is tried as a whole way",
        "truth": verify(robot, fast, [q[0] for q in questions], answers),
    }


def verify(
    robot: RobotModel,
    checker: ReachabilityChecker,
    grasps: list[FloatArray],
    answers: list[ReachResult],
) -> dict[str, Any]:
    """Check what was told to be reachable: pose, limits, and the engine's contacts.

    The engine sees the robot and the table; every posture of approach and lift counts.
    """
    errors, beyond, self_depth, table_depth = [], 0.0, 0.0, 0.0
    postures = 0
    with World() as world:
        world.reset()
        body = RobotBody(world, robot_setup(robot), np.eye(4), robot.home)
        table = world.load_box(np.asarray(TABLE.size) / 2, TABLE.T_base_box)
        for poses, answer in zip(grasps, answers, strict=True):
            for row in np.flatnonzero(answer.reachable):
                arm = checker.arms[answer.arm_of(int(row))]
                wanted = flip_gripper(poses[row]) if answer.flipped[row] else poses[row]
                q = answer.q[row].copy()
                errors.append(_error(arm.forward(q[arm.indices])[0], wanted))
                own = robot.limits.take(arm.indices)
                width = len(arm.indices)
                way = np.concatenate([answer.approach[row], answer.lift[row]])[
                    :, :width
                ]
                outside = np.maximum(own.lower - way, way - own.upper)
                beyond = max(beyond, float(outside.max()))
                for values in way:
                    q[arm.indices] = values
                    body.place(q)
                    table_depth = max(table_depth, body.depth_in(table))
                    if postures % EVERY == 0:
                        self_depth = max(self_depth, body.own_depth())
                    postures += 1
    worst = np.array(errors).reshape(-1, 2).max(axis=0, initial=0.0)
    return {
        "configurations": len(errors),
        "postures": postures,
        "position_error_mm": 1e3 * float(worst[0]),
        "rotation_error_mrad": 1e3 * float(worst[1]),
        "beyond_limits": max(0.0, beyond),
        "postures_looked_at_for_own": -(-postures // EVERY),
        "deepest_own_mm": 1e3 * self_depth,
        "deepest_table_mm": 1e3 * table_depth,
        "allowed_mm": 1e3 * DEEP,
    }


def _error(reached: FloatArray, wanted: FloatArray) -> tuple[float, float]:
    between = invert(wanted) @ reached
    turn = Rotation.from_matrix(between[:3, :3]).magnitude()
    return float(np.linalg.norm(between[:3, 3])), float(turn)
