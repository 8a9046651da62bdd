# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from diamond import SMALL_NETWORK, diamond_network

from neugrasp_ros.benchmark.oracles import (
    ORACLES,
    candidates_policy,
    oracle_policy,
    true_field,
)
from neugrasp_ros.benchmark.protocol import Look
from neugrasp_ros.config import PlannerConfig, RenderConfig
from neugrasp_ros.geometry.grid import ScalarGrid
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.mesh import box_mesh
from neugrasp_ros.geometry.raycast import MeshScene
from neugrasp_ros.geometry.transform import translation
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.model import save_network
from sim_bridge.observation import draw_view, mesh_scene, observe
from sim_bridge.scene import SceneMeshes

HALF = np.array([0.02, 0.03, 0.04])
CENTER = np.array([0.15, 0.15, 0.09])
TABLE_TOP = 0.05


HOLDING = 0.07  # [m], the width of the jaws of grasps that hold


def one_holds(grasps):
    """Tell one grasp after another, by its width."""
    for width in grasps.widths:
        yield bool(width == HOLDING)


@pytest.fixture
def look():
    """A box on the table; the network completes a diamond somewhere else."""
    truth = SceneMeshes((box_mesh(HALF),), translation(*CENTER)[None], (0,))
    rng = np.random.default_rng(0)
    pose = draw_view("random", rng, any_azimuth=False)
    view = observe(mesh_scene(truth, table=True), pose, rng, noise="none")
    return Look(view, load_gripper("panda"), TABLE_TOP, (), truth, one_holds)


def test_the_true_field_has_its_surface_where_the_object_has():
    like = ScalarGrid(np.zeros((120, 120, 120), dtype=np.float32), 0.0025)
    objects = MeshScene([box_mesh(HALF)], translation(*CENTER)[None])
    field = true_field(objects, like)
    for axis, side in ((0, 1), (1, -1), (2, 1)):
        outward = side * np.eye(3)[axis]
        face = CENTER + outward * HALF[axis]
        assert field.sample(face - 0.002 * outward) > 0
        assert field.sample(face + 0.002 * outward) < 0


@pytest.fixture
def config(tmp_path):
    """A network that completes a diamond where nothing is."""
    weights = tmp_path / "diamond.safetensors"
    elsewhere = np.array([0.07, 0.07, 0.09])
    save_network(diamond_network(SMALL_NETWORK, elsewhere, 0.03), weights)
    return PlannerConfig(
        weights=str(weights),
        render=RenderConfig(image_size=24),
        max_candidates=32,
        threads=1,
    )


@pytest.mark.parametrize(
    "widths, expected", [((0.08, 0.07, 0.07), 0.4), ((0.08, 0.08, 0.08), None)]
)
def test_the_candidates_oracle_takes_the_best_that_holds(
    widths, expected, look, config, monkeypatch
):
    poses = np.stack([translation(*CENTER)] * 3)
    grasps = GraspSet(poses, np.array(widths))
    qualities = np.array([0.9, 0.2, 0.4])
    planner = "neugrasp_ros.pipeline.GraspPlanner"
    monkeypatch.setattr(f"{planner}.sample", lambda *_, **__: grasps)
    monkeypatch.setattr(
        f"{planner}.evaluate", lambda *_, **__: grasps.with_scores(qualities)
    )
    plan = candidates_policy(config)(look, np.random.default_rng(0))
    assert plan.grasps.quality.tolist() == ([] if expected is None else [expected])
    assert plan.n_candidates == 3


@pytest.mark.parametrize("name", list(ORACLES))
def test_an_oracle_is_told_the_truth_where_it_says(name, look, config, monkeypatch):
    seen = {}
    hand = GraspSet(translation(*CENTER)[None], np.array([0.08]))

    def sampled(self, scene, **_):
        seen["sampling"] = scene
        return hand

    def scored(self, scene, grasps, **_):
        seen["local"] = scene
        return grasps.with_scores(np.array([0.9]))

    monkeypatch.setattr("neugrasp_ros.pipeline.GraspPlanner.sample", sampled)
    monkeypatch.setattr("neugrasp_ros.pipeline.GraspPlanner.evaluate", scored)
    plan = oracle_policy(name, config)(look, np.random.default_rng(0))
    assert len(plan.grasps) == 1
    for stage, scene in seen.items():
        told = stage in ORACLES[name]
        assert (scene.field.sample(CENTER) > 0) == told
        assert (scene.depth(CENTER[None])[0] > 0) == told
