# SPDX-License-Identifier: Apache-2.0
"""Our strict grasp execution: a grasp counts only if a robot could live with it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import invert, translation
from sim_bridge.gripper import SimGripper
from sim_bridge.paths import shake_path, straight_path, tilt_path
from sim_bridge.trial_result import (
    DISTURBED,
    EMPTY,
    PREGRASP_COLLISION,
    SLIPPED,
    SNAGGED,
    TABLE_CONTACT,
    TrialResult,
)
from sim_bridge.world import TIME_STEP, World

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class StrictRules:
    """What the strict protocol does and allows.

    Attributes:
        pregrasp_distance: Length of the approach in [m].
        approach_speed: In [m/s].
        table_force: Largest force on table or tray on approach in [N].
        moved: Largest motion of any object before the jaws close in [m].
        turned: The same as an angle in [rad].
        jaw_speed: Of each finger in [m/s].
        least_opening: Share of the opening that a held object keeps open [-].
        lift_distance: In [m].
        lift_speed: In [m/s].
        shake_amplitude: In [m].
        shake_frequency: In [Hz].
        shake_duration: Along each horizontal axis, in [s].
        tilt_angle: To either side in [rad].
        tilt_duration: Of the whole swing in [s].
        hold_duration: In [s].
        slip: Largest motion of the object in the hand since closing in [m].
    """

    pregrasp_distance: float = 0.10
    approach_speed: float = 0.10
    table_force: float = 5.0
    moved: float = 0.01
    turned: float = np.deg2rad(10.0)
    jaw_speed: float = 0.10
    least_opening: float = 0.1
    lift_distance: float = 0.20
    lift_speed: float = 0.15
    shake_amplitude: float = 0.02
    shake_frequency: float = 2.0
    shake_duration: float = 1.0
    tilt_angle: float = np.deg2rad(20.0)
    tilt_duration: float = 1.0
    hold_duration: float = 0.5
    slip: float = 0.03


def run_strict_trial(
    world: World,
    gripper: SimGripper,
    T_world_gripper: FloatArray,
    opening: float,
    rules: StrictRules,
) -> TrialResult:
    """Approach without doing harm, close, lift, shake, tilt, hold, and judge.

    Args:
        world: The world.
        gripper: The gripper in it.
        T_world_gripper: Grasp pose, shape (4, 4).
        opening: Opening of the jaws on approach in [m].
        rules: What is done and allowed.
    """
    distance = rules.pregrasp_distance
    T_world_pregrasp = T_world_gripper @ translation(0.0, 0.0, -distance)
    with world.saved_state() as state:
        colliding = bool(gripper.query_contacts(T_world_pregrasp, opening))
        world.restore(state)
    if colliding:
        return TrialResult(
            reason=PREGRASP_COLLISION, width=opening, stop_depth=distance, touched=True
        )
    watch = _ApproachWatch(world, gripper, rules)
    gripper.teleport(T_world_pregrasp, opening)
    spacing = rules.approach_speed * TIME_STEP
    path = straight_path(T_world_pregrasp, T_world_gripper[:3, 3], spacing)
    if gripper.follow(path, 1, watch.has_failed) is not None:
        gap = T_world_gripper[:3, 3] - gripper.commanded[:3, 3]
        return TrialResult(
            reason=watch.reason,
            width=opening,
            stop_depth=float(np.linalg.norm(gap)),
            touched=True,
        )
    gripper.close(speed=rules.jaw_speed)
    return _lift_and_judge(world, gripper, rules, watch.touched)


class _ApproachWatch:
    """Watches an approach for what must not happen before the jaws close."""

    def __init__(self, world: World, gripper: SimGripper, rules: StrictRules) -> None:
        self._world, self._gripper, self._rules = world, gripper, rules
        self._before = {body: world.pose(body) for body in world.object_ids}
        self.touched = False
        self.reason = ""

    def has_failed(self) -> bool:
        """Judge the last step; ``reason`` then says why."""
        contacts = self._gripper.contacts()
        self.touched = self.touched or bool(contacts)
        if not self.touched:
            return False  # nobody else moves anything
        force = sum(c.force for c in contacts if c.body_b not in self._before)
        if force > self._rules.table_force:
            self.reason = TABLE_CONTACT
        elif any(self._is_disturbed(body) for body in self._before):
            self.reason = DISTURBED
        return bool(self.reason)

    def _is_disturbed(self, body: int) -> bool:
        T_before_now = invert(self._before[body]) @ self._world.pose(body)
        center = self._world.model(body).center_of_mass
        moved = T_before_now[:3, :3] @ center + T_before_now[:3, 3] - center
        cosine = np.clip((np.trace(T_before_now[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)
        return bool(
            np.linalg.norm(moved) > self._rules.moved
            or np.arccos(cosine) > self._rules.turned
        )


def _lift_and_judge(
    world: World, gripper: SimGripper, rules: StrictRules, touched: bool
) -> TrialResult:
    least = rules.least_opening * gripper.gripper.max_opening
    fingers = gripper.finger_contacts()
    objects = frozenset(world.object_ids)
    if (
        gripper.width() < least
        or not fingers.left & objects
        or not fingers.right & objects
    ):
        return TrialResult(reason=EMPTY, width=gripper.width(), touched=touched)
    before = {
        body: _center_in_gripper(world, gripper, body)
        for body in fingers.left | fingers.right
        if body in objects
    }
    _lift_and_shake(world, gripper, rules)
    held = _held_object(world, gripper)
    reason = ""
    if held == -1 or held not in before:
        reason = SLIPPED
    elif (
        np.linalg.norm(_center_in_gripper(world, gripper, held) - before[held])
        > rules.slip
    ):
        reason = SLIPPED
    elif any(
        contact.body_b != gripper.body and contact.distance <= 0.0
        for contact in world.contacts(held)
    ):
        reason = SNAGGED
    return TrialResult(
        reason=reason,
        width=gripper.width(),
        touched=touched,
        object_body=-1 if reason else held,
    )


def _held_object(world: World, gripper: SimGripper) -> int:
    fingers = gripper.finger_contacts()
    shared = sorted(fingers.left & fingers.right & frozenset(world.object_ids))
    return shared[0] if shared else -1


def _center_in_gripper(world: World, gripper: SimGripper, body: int) -> FloatArray:
    T_gripper_world = invert(gripper.pose())
    center = world.center_of_mass(body)
    return np.asarray(T_gripper_world[:3, :3] @ center + T_gripper_world[:3, 3])


def _lift_and_shake(world: World, gripper: SimGripper, rules: StrictRules) -> None:
    start = gripper.commanded
    top = start[:3, 3] + [0.0, 0.0, rules.lift_distance]
    gripper.follow(straight_path(start, top, rules.lift_speed * TIME_STEP), 1)
    lifted = gripper.commanded
    for direction in np.eye(3)[:2]:
        path = shake_path(
            lifted,
            direction,
            amplitude=rules.shake_amplitude,
            frequency=rules.shake_frequency,
            duration=rules.shake_duration,
            time_step=TIME_STEP,
        )
        gripper.follow(path, 1)
    path = tilt_path(
        lifted,
        _horizontal_axis(lifted),
        angle=rules.tilt_angle,
        duration=rules.tilt_duration,
        time_step=TIME_STEP,
    )
    gripper.follow(path, 1)
    gripper.follow([lifted], round(rules.hold_duration / TIME_STEP))


def _horizontal_axis(T_world_gripper: FloatArray) -> FloatArray:
    """Return the horizontal direction nearest to the closing axis, else to x."""
    for column in (1, 0):
        axis = T_world_gripper[:3, column] * [1.0, 1.0, 0.0]
        length = float(np.linalg.norm(axis))
        if length > 0.1:
            return np.asarray(axis / length)
    return np.array([1.0, 0.0, 0.0])
