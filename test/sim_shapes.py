# SPDX-License-Identifier: Apache-2.0
"""Objects and poses of known geometry for the tests of the simulator."""

import numpy as np

from neugrasp_ros.geometry.transform import translation
from sim_bridge.objects.model import ObjectModel, Part, part_mesh
from sim_bridge.objects.registry import ObjectSet
from sim_bridge.world import TABLE_HEIGHT

DOWN = np.diag([1.0, -1.0, -1.0, 1.0])  # gripper frame looking straight down


def model_of(*parts: Part, mass: float = 0.1) -> ObjectModel:
    return ObjectModel("thing", "test", parts, tuple(map(part_mesh, parts)), mass)


def box_model(*half_extents: float) -> ObjectModel:
    return model_of(Part("box", half_extents))


def standing(half_height: float, x: float = 0.15, y: float = 0.15) -> np.ndarray:
    return translation(x, y, TABLE_HEIGHT + half_height)


def looking_down(x: float, y: float, z: float) -> np.ndarray:
    return translation(x, y, z) @ DOWN


def block_set() -> ObjectSet:
    models = {
        "cube": box_model(0.02, 0.02, 0.02),
        "bar": box_model(0.015, 0.04, 0.02),
        "can": model_of(Part("cylinder", (0.025, 0.08))),
        "ell": model_of(
            Part("box", (0.015, 0.04, 0.015)),
            Part("box", (0.015, 0.015, 0.03), translation(0.0, 0.025, 0.03)),
        ),
    }
    return ObjectSet("blocks", models, models.__getitem__)
