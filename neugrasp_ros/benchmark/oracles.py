# SPDX-License-Identifier: Apache-2.0
"""Policies that are told a part of the truth: what each stage of the way costs.

The completed surface serves twice: candidates are sampled on it, and their local views
are rendered from it. An oracle puts the true surface in its place for one of the two,
or for both; what then is still lost is lost by the scores. ``oracle_candidates`` is
told which of the best-scored ``TRIES`` candidates hold: what it loses is lost because
there is none among them that does.
"""

from contextlib import closing
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from neugrasp_ros.benchmark.planning import Planning, answer, sample, worth_trying
from neugrasp_ros.benchmark.protocol import Look, Plan, Policy
from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.pipeline import EncodedScene
from neugrasp_ros.scene.field import LOGIT_LIMIT
from sim_bridge.observation import mesh_scene

SMOOTHING = 0.7  # samples: places the surface between them
BEST_CANDIDATE = "oracle_candidates"
TRIES = 64  # of up to 256 candidates: more would take minutes a look

ORACLES = {
    "oracle_sampling": ("sampling",),
    "oracle_local": ("local",),
    "oracle_surface": ("sampling", "local"),
}


def true_field(objects: MeshScene, like: ScalarGrid) -> ScalarGrid:
    """Return the occupancy of the true objects on a field's samples.

    Args:
        objects: The true objects, without their support.
        like: The field whose samples and spacing are taken.
    """
    axes = [(np.arange(n) + 0.5) * like.spacing for n in like.values.shape]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = objects.contains(points.reshape(-1, 3)).reshape(like.values.shape)
    smooth = gaussian_filter(inside.astype(np.float32), SMOOTHING)
    logits = (2.0 * smooth - 1.0) * np.float32(LOGIT_LIMIT)
    return ScalarGrid(logits, like.spacing, like.normal_reach)


@dataclass(frozen=True, eq=False)
class TrueScene(EncodedScene):
    """A scene whose surface is the true one; its planes are the network's."""

    def depth(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the true field (N,) at points (N, 3) in [m]."""
        return self.field.sample(points)


def true_scene(scene: EncodedScene, objects: MeshScene) -> TrueScene:
    """Put the true surface in the place of the completed one."""
    values = {item.name: getattr(scene, item.name) for item in fields(EncodedScene)}
    return TrueScene(**{**values, "field": true_field(objects, scene.field)})


def candidates_policy(config: PlannerConfig) -> Policy:
    """Return the policy that takes the best-scored candidate that truly holds."""
    planning = Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, scene, grasps = planning.candidates(look, rng)
        scored = planner.evaluate(scene, grasps, support_height=look.table_height)
        tried = scored.take(np.argsort(-scored.quality, kind="stable")[:TRIES])
        with closing(look.holds(tried)) as holds:
            row = next((i for i, good in enumerate(holds) if good), None)
        best = tried.take(np.array([] if row is None else [row], dtype=np.int64))
        return answer(look, best, planner, scene, grasps)

    return choose


def oracle_policy(name: str, config: PlannerConfig) -> Policy:
    """Return the network's policy with the true surface in some stages.

    Args:
        name: One of ``ORACLES``.
        config: The planner's settings.
    """
    told = ORACLES[name]
    planning = Planning(config)

    def choose(look: Look, rng: np.random.Generator) -> Plan:
        planner, completed = planning.encode(look)
        true = true_scene(completed, mesh_scene(look.truth, table=False))
        sampled = true if "sampling" in told else completed
        grasps = sample(planner, look, sampled, rng)
        scene = true if "local" in told else completed
        scored = planner.evaluate(scene, grasps, support_height=look.table_height)
        good = worth_trying(scored, look.failed)
        return answer(look, good, planner, completed, grasps)

    return choose
