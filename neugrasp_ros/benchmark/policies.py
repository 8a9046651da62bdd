# SPDX-License-Identifier: Apache-2.0
"""Who chooses the grasps: the network, the floors it must rise above, and oracles."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from neugrasp_ros.benchmark.oracles import (
    BEST_CANDIDATE,
    ORACLES,
    candidates_policy,
    oracle_policy,
)
from neugrasp_ros.benchmark.planning import Planning, answer, worth_trying
from neugrasp_ros.benchmark.protocol import Look, Plan, Policy
from neugrasp_ros.benchmark.seams import EXTRA_VOXELS, moved_back, moved_look
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import UnknownNameError
from neugrasp_ros.geometry.gripper import load_gripper


def neugrasp_policy(config: PlannerConfig, extra_voxels: int = 0) -> Policy:
    """Return the policy that ranks by predicted quality and refuses poor grasps."""
    planning = Planning(config, extra_voxels)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        scored = planner.evaluate(scene, grasps, support_height=look.table_height)
        good = worth_trying(scored, look.failed)
        return answer(look, good, planner, scene, grasps)

    return choose


def seams_policy(config: PlannerConfig) -> Policy:
    """Return the network's policy with the scene where four cubes meet."""
    policy = neugrasp_policy(config, EXTRA_VOXELS)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        return moved_back(policy(moved_look(look), rng))

    return choose


def reference_policy(config: PlannerConfig) -> Policy:
    """Return the network's policy with the paper's renderers, far slower."""
    return neugrasp_policy(replace(config, renderer="compiled_reference"))


def no_scene_render_policy(config: PlannerConfig) -> Policy:
    """Return the network's policy with candidates on what was seen alone."""
    return neugrasp_policy(replace(config, scene_render=False))


def scored_policy(config: PlannerConfig) -> Policy:
    """Return the policy that answers every candidate with its scores, unranked."""
    planning = Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        scored = planner.evaluate(scene, grasps, support_height=look.table_height)
        return answer(look, scored, planner, scene, grasps)

    return choose


def random_policy(config: PlannerConfig) -> Policy:
    """Return the floor that takes any collision-free candidate of the same sampler."""
    planning = Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        shuffled = grasps.take(rng.permutation(len(grasps)))
        return answer(look, shuffled, planner, scene, grasps)

    return choose


def geometry_policy(config: PlannerConfig) -> Policy:
    """Return the floor that takes the best antipodal score on the sampled surface.

    The sampler returns its candidates by that score, so the first one is taken.
    """
    planning = Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        return answer(look, grasps, planner, scene, grasps)

    return choose


def make_policy(name: str, config: PlannerConfig) -> Policy:
    """Return a policy by name.

    Raises:
        UnknownNameError: If there is none of that name.
    """
    makers: dict[str, Callable[[PlannerConfig], Policy]] = {
        "neugrasp": neugrasp_policy,
        "reference": reference_policy,
        "no_scene_render": no_scene_render_policy,
        "seams": seams_policy,
        "random": random_policy,
        "geometry": geometry_policy,
        "scored": scored_policy,
        BEST_CANDIDATE: candidates_policy,
        **{name: partial(oracle_policy, name) for name in ORACLES},
    }
    if name not in makers:
        raise UnknownNameError("policy", name, makers)
    load_gripper(config.gripper)
    return makers[name](config)
