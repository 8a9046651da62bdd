# SPDX-License-Identifier: Apache-2.0
"""The clutter-removal benchmark's grasp execution, in full or with short cuts."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import translation
from sim_bridge.gripper import SimGripper
from sim_bridge.paths import shake_path, straight_path
from sim_bridge.trial_result import (
    EMPTY,
    SLIPPED,
    TrialResult,
)
from sim_bridge.world import TIME_STEP, World

FloatArray = NDArray[np.float64]

PREGRASP_DISTANCE = 0.05  # [m]
WAYPOINT_SPACING = 0.002  # [m]
STEPS_PER_WAYPOINT = 4  # nominally 0.10 m/s
SIDE_ANGLE = np.pi / 3  # an approach flatter than this retreats straight up
RUN_UP = 4  # waypoints before the first contact at which a short cut starts to move
PUSHING_ITERATIONS = 150  # between speed and the full execution: `neugrasp agreement`
LOOKS_APART = 5  # waypoints between two looks whether the object is lost


@dataclass(frozen=True, slots=True)
class VgnRules:
    """The benchmark's execution.

    Attributes:
        pregrasp_distance: Length of the approach in [m].
        retreat_distance: Length of the retreat in [m].
        least_opening: Share of the opening that a held object keeps open [-].
        skip_free_motion: Leave out what cannot change the outcome: motion before the
            first contact, and all that follows jaws that have closed on nothing.
        touching_iterations: Solver iterations from the moment on that an approach
            with short cuts meets something: pushing needs more of them than holding.
        shake: Shake what was lifted and tell whether it stayed.
        shake_amplitude: In [m].
        shake_frequency: In [Hz].
        shake_duration: Along each horizontal axis, in [s].
    """

    pregrasp_distance: float = PREGRASP_DISTANCE
    retreat_distance: float = 0.10
    least_opening: float = 0.1
    skip_free_motion: bool = False
    touching_iterations: int = PUSHING_ITERATIONS
    shake: bool = False
    shake_amplitude: float = 0.02
    shake_frequency: float = 2.0
    shake_duration: float = 0.5


def run_vgn_trial(
    world: World,
    gripper: SimGripper,
    T_world_gripper: FloatArray,
    opening: float,
    rules: VgnRules,
) -> TrialResult:
    """Approach until the first contact, close, retreat, and see what is held.

    The benchmark's own test at the pre-grasp never fires (nothing has refreshed the
    contacts yet), so the full execution goes without it.

    Args:
        world: The world.
        gripper: The gripper in it.
        T_world_gripper: Grasp pose, shape (4, 4).
        opening: Opening of the jaws on approach in [m].
        rules: The execution.
    """
    T_world_start = T_world_gripper @ translation(0.0, 0.0, -rules.pregrasp_distance)
    if rules.skip_free_motion:
        first = _first_contact(world, gripper, T_world_gripper, opening, rules)
        if first is not None:
            world.solver_iterations = rules.touching_iterations
        T_world_start = _run_up_pose(T_world_gripper, first, rules)
    gripper.teleport(T_world_start, opening)
    if world.sleeping:
        world.put_to_sleep()
    path = straight_path(T_world_start, T_world_gripper[:3, 3], WAYPOINT_SPACING)
    stop = None
    if np.linalg.norm(T_world_start[:3, 3] - T_world_gripper[:3, 3]) > 1e-9:
        stop = gripper.follow(path, STEPS_PER_WAYPOINT, gripper.has_contact)
    stop_depth = _depth_before(T_world_gripper, gripper.commanded)
    least = rules.least_opening * gripper.gripper.max_opening
    gripper.close(shut_at=least if rules.skip_free_motion else -np.inf)
    approach = (stop is not None, stop_depth)
    return _retreat_and_judge(world, gripper, T_world_gripper, rules, approach, least)


def swept_contacts(
    gripper: SimGripper, T_world_gripper: FloatArray, opening: float, distance: float
) -> bool:
    """Tell whether the open gripper touches anything on its straight approach.

    Every box of the gripper is convex and moves along its own axis, so looks at most
    a finger length apart leave no gap.
    """
    finger = gripper.gripper.finger_depth
    shortest = 0.9 * min(finger, gripper.gripper.palm_size[2])
    looks = max(int(np.ceil(distance / shortest)), 1)
    return any(
        gripper.query_contacts(
            T_world_gripper @ translation(0.0, 0.0, -distance * index / looks), opening
        )
        for index in range(looks + 1)
    )


def _first_contact(
    world: World,
    gripper: SimGripper,
    T_world_gripper: FloatArray,
    opening: float,
    rules: VgnRules,
) -> int | None:
    """Return the first waypoint with a contact, 0 at the pre-grasp, None if free."""
    distance = rules.pregrasp_distance
    with world.saved_state() as state:
        first = None
        if swept_contacts(gripper, T_world_gripper, opening, distance):
            first = next(
                index
                for index, depth in enumerate(_waypoint_depths(distance))
                if gripper.query_contacts(
                    T_world_gripper @ translation(0.0, 0.0, -depth), opening
                )
            )
        world.restore(state)
    return first


def _waypoint_depths(distance: float) -> FloatArray:
    return np.linspace(distance, 0.0, round(distance / WAYPOINT_SPACING) + 1)


def _run_up_pose(
    T_world_gripper: FloatArray, first: int | None, rules: VgnRules
) -> FloatArray:
    depth = 0.0
    if first is not None:
        depths = _waypoint_depths(rules.pregrasp_distance)
        depth = depths[max(first - RUN_UP, 0)]
    return T_world_gripper @ translation(0.0, 0.0, -depth)


def _depth_before(T_world_gripper: FloatArray, T_world_now: FloatArray) -> float:
    approach = T_world_gripper[:3, 2]
    return float(approach @ (T_world_gripper[:3, 3] - T_world_now[:3, 3]))


def _retreat_and_judge(
    world: World,
    gripper: SimGripper,
    T_world_gripper: FloatArray,
    rules: VgnRules,
    approach: tuple[bool, float],
    least: float,
) -> TrialResult:
    touched, stop_depth = approach

    def is_lost() -> bool:
        return gripper.width() <= least or not gripper.has_contact()

    if rules.skip_free_motion and gripper.width() <= least:
        return TrialResult(
            reason=EMPTY,
            width=gripper.width(),
            stop_depth=stop_depth,
            touched=touched,
        )
    fingers = gripper.finger_contacts()
    closed_on_nothing = is_lost() or not fingers.left or not fingers.right
    path = list(_retreat_path(gripper, T_world_gripper, rules))
    for start in range(0, len(path), LOOKS_APART):
        gripper.follow(path[start : start + LOOKS_APART], STEPS_PER_WAYPOINT)
        if rules.skip_free_motion and gripper.width() <= least:
            break
    if is_lost():
        reason = EMPTY if closed_on_nothing else SLIPPED
        return TrialResult(
            reason=reason,
            width=gripper.width(),
            stop_depth=stop_depth,
            touched=touched,
        )
    return TrialResult(
        reason="",
        width=gripper.width(),
        stop_depth=stop_depth,
        touched=touched,
        object_body=_held_body(world, gripper),
        shake_held=_shake(gripper, rules, least) if rules.shake else None,
    )


def _held_body(world: World, gripper: SimGripper) -> int:
    """Return the object of the first contact: the benchmark clears just that one."""
    touched = (contact.body_b for contact in gripper.contacts())
    return next((body for body in touched if body in world.object_ids), -1)


def _retreat_path(
    gripper: SimGripper, T_world_gripper: FloatArray, rules: VgnRules
) -> list[FloatArray]:
    approach = T_world_gripper[:3, 2]
    target = T_world_gripper[:3, 3].copy()
    if np.arccos(np.clip(-approach[2], -1.0, 1.0)) > SIDE_ANGLE:
        target[2] += rules.retreat_distance
    else:
        target -= rules.retreat_distance * approach
    return list(straight_path(gripper.pose(), target, WAYPOINT_SPACING))


def _shake(gripper: SimGripper, rules: VgnRules, least: float) -> bool:
    start = gripper.commanded
    for direction in np.eye(3)[:2]:
        path = shake_path(
            start,
            direction,
            amplitude=rules.shake_amplitude,
            frequency=rules.shake_frequency,
            duration=rules.shake_duration,
            time_step=TIME_STEP,
        )
        gripper.follow(path, 1)
    fingers = gripper.finger_contacts()
    return gripper.width() > least and bool(fingers.left & fingers.right)
