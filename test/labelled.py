# SPDX-License-Identifier: Apache-2.0
"""Labelled scenes that no physics has seen: one object, and hands at will."""

from dataclasses import fields

import numpy as np
from field_shapes import hand_at

from neugrasp_ros.datagen.labels import GraspLabels, SceneLabels
from neugrasp_ros.geometry.gripper import load_gripper
from neugrasp_ros.geometry.transform import to_position_quaternion, translation
from sim_bridge.objects.registry import object_set
from sim_bridge.scene import PlacedObject, Scene

CENTER = np.array([0.15, 0.15, 0.09])  # [m], of the object
TOP = hand_at(CENTER, [0, 0, -1], [0, 1, 0])
SIDE = hand_at(CENTER, [1, 0, -0.2], [0, 1, 0])
ASTRAY = hand_at(np.array([0.05, 0.05, 0.25]), [0, 0, -1], [0, 1, 0])


def labels_of(*poses: np.ndarray, index: int = 0) -> SceneLabels:
    """Label hands in turn as failures and successes."""
    n = len(poses)
    position, quaternion = to_position_quaternion(np.stack(poses))
    values = {f.name: np.zeros(n, dtype=np.uint8) for f in fields(GraspLabels)}
    values |= {
        "positions": position.astype(np.float32),
        "quaternions": quaternion.astype(np.float32),
        "openings": np.full(n, 0.08, dtype=np.float32),
        "labels": (np.arange(n) % 2).astype(np.uint8),
        "tried": np.ones(n, dtype=bool),
        "affordances": np.zeros((n, 7), dtype=np.uint8),
    }
    name = object_set("procedural").names[0]
    placed = PlacedObject("procedural", name, 1.0, translation(*CENTER))
    scene = Scene("packed", 0, (placed,))
    return SceneLabels(index, scene, load_gripper("panda"), GraspLabels(**values))
