# SPDX-License-Identifier: Apache-2.0
"""Work for the label factory's processes, and labels without physics."""

import os

import numpy as np

from neugrasp_ros.datagen.labels import GraspLabels, SceneLabels
from neugrasp_ros.errors import SimulationError
from neugrasp_ros.geometry.gripper import load_gripper
from sim_bridge.scene import PlacedObject, Scene


def square_or_die(job):
    """Square a number; 2 kills the process, 3 is refused."""
    if job == 2:
        os._exit(7)
    if job == 3:
        raise SimulationError("three is refused")
    return job * job


def labels_of(index, n_grasps=4, kind="pile"):
    """Make up a labelled scene that depends on its index alone."""
    rng = np.random.default_rng(index)
    pose = np.eye(4)
    pose[:3, 3] = rng.random(3)
    placed = PlacedObject("blocks", f"block{index}", 0.9, pose)
    quaternions = rng.normal(size=(n_grasps, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    flags = rng.random((5, n_grasps)) < 0.5
    labels = rng.integers(2, size=n_grasps).astype(np.uint8)
    grasps = GraspLabels(
        positions=rng.random((n_grasps, 3)).astype(np.float32),
        quaternions=quaternions.astype(np.float32),
        openings=np.full(n_grasps, 0.08, dtype=np.float32),
        widths=rng.random(n_grasps).astype(np.float32),
        stop_depths=np.zeros(n_grasps, dtype=np.float32),
        labels=labels,
        reasons=np.where(labels == 1, 0, 4).astype(np.uint8),
        tried=flags[0],
        touched=flags[1],
        hits_pregrasp=flags[2],
        hits_approach=flags[3],
        hits_grasp=flags[4],
        shake_held=np.full(n_grasps, -1, dtype=np.int8),
        object_ids=np.zeros(n_grasps, dtype=np.int8),
        sources=np.zeros(n_grasps, dtype=np.uint8),
        affordances=rng.integers(2, size=(n_grasps, 7)).astype(np.uint8),
    )
    return SceneLabels(index, Scene(kind, 5, (placed,)), load_gripper("panda"), grasps)


def label_or_fail(job):
    """Label a job's scene; index 1 has a broken object."""
    if job.index == 1:
        raise SimulationError("broken mesh")
    return labels_of(job.index)
