# SPDX-License-Identifier: Apache-2.0
"""One physical grasp attempt: how it is configured, run, and what comes out."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import ConfigError, UnknownNameError
from neugrasp_ros.geometry.transform import translation
from sim_bridge.gripper import SimGripper
from sim_bridge.strict_trial import StrictRules, run_strict_trial
from sim_bridge.trial_result import TrialResult
from sim_bridge.vgn_trial import (
    PREGRASP_DISTANCE,
    VgnRules,
    run_vgn_trial,
    swept_contacts,
)
from sim_bridge.world import BENCHMARK_ITERATIONS, FAST_ITERATIONS, World

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TrialConfig:
    """How grasps are tried.

    Attributes:
        rules: What the gripper does and what counts as success.
        solver_iterations: Constraint solver iterations per step.
        sleeping: Put objects to sleep before each trial; the gripper's touch wakes
            them. Needs a world made with ``sleeping=True``.
    """

    rules: VgnRules | StrictRules
    solver_iterations: int = BENCHMARK_ITERATIONS
    sleeping: bool = False


TRIAL_PRESETS = {
    "vgn": TrialConfig(VgnRules()),
    "fast": TrialConfig(
        VgnRules(skip_free_motion=True), FAST_ITERATIONS, sleeping=True
    ),
    "fast_shake": TrialConfig(
        VgnRules(skip_free_motion=True, shake=True), FAST_ITERATIONS, sleeping=True
    ),
    "strict": TrialConfig(StrictRules()),
}


def trial_config(name: str) -> TrialConfig:
    """Return a preset by name.

    Raises:
        UnknownNameError: If there is none of that name.
    """
    if name not in TRIAL_PRESETS:
        raise UnknownNameError("trial preset", name, TRIAL_PRESETS)
    return TRIAL_PRESETS[name]


def run_trial(
    world: World,
    gripper: SimGripper,
    T_world_gripper: FloatArray,
    opening: float,
    config: TrialConfig,
) -> TrialResult:
    """Try one grasp in the world as it is, and leave the world as it then is.

    Args:
        world: A world at rest.
        gripper: A gripper in it, wherever it is.
        T_world_gripper: Grasp pose of the TCP with open jaws, shape (4, 4).
        opening: Opening of the jaws on approach in [m].
        config: How to try.

    Raises:
        ConfigError: If the preset wants sleeping objects and the world forbids them.
    """
    if config.sleeping and not world.sleeping:
        raise ConfigError("this trial wants a World(sleeping=True)")
    if world.solver_iterations != config.solver_iterations:
        world.solver_iterations = config.solver_iterations
    if isinstance(config.rules, StrictRules):
        return run_strict_trial(world, gripper, T_world_gripper, opening, config.rules)
    return run_vgn_trial(world, gripper, T_world_gripper, opening, config.rules)


def run_trials(
    world: World,
    gripper: SimGripper,
    grasps: Iterable[tuple[FloatArray, float]],
    config: TrialConfig,
) -> Iterator[TrialResult]:
    """Try grasps, each from the same state of the world, which is restored at the end.

    Args:
        world: A world at rest.
        gripper: A gripper in it.
        grasps: Pairs of pose ``T_world_gripper`` and opening, see ``run_trial``.
        config: How to try.

    Yields:
        One result for each grasp, in their order.
    """
    gripper.park()
    with world.saved_state() as state:
        for T_world_gripper, opening in grasps:
            yield run_trial(world, gripper, T_world_gripper, opening, config)
            world.restore(state)
            gripper.park()


class CollisionLabel(NamedTuple):
    """Whether the open gripper touches anything, by a query without motion.

    Attributes:
        pregrasp: At the pre-grasp pose.
        approach: Anywhere on the straight way from there to the grasp, ends included.
        grasp: At the grasp pose.
    """

    pregrasp: bool
    approach: bool
    grasp: bool


def collision_label(
    gripper: SimGripper,
    T_world_gripper: FloatArray,
    opening: float,
    pregrasp_distance: float = PREGRASP_DISTANCE,
) -> CollisionLabel:
    """Tell whether the open gripper is free at and before a grasp.

    The gripper is left where it was asked about: restore a state or park it before
    the next step. Gaps below the engine's contact threshold of up to 2 mm count.

    Args:
        gripper: The gripper in its world.
        T_world_gripper: Grasp pose, shape (4, 4).
        opening: Opening of the jaws in [m].
        pregrasp_distance: Length of the approach in [m].
    """
    T_world_pregrasp = T_world_gripper @ translation(0.0, 0.0, -pregrasp_distance)
    pregrasp = bool(gripper.query_contacts(T_world_pregrasp, opening))
    grasp = bool(gripper.query_contacts(T_world_gripper, opening))
    approach = pregrasp or grasp
    approach = approach or swept_contacts(
        gripper, T_world_gripper, opening, pregrasp_distance
    )
    return CollisionLabel(pregrasp, approach, grasp)
