# SPDX-License-Identifier: Apache-2.0
"""The one folder that knows the order of the stages.

Volume -> encode -> field -> render the scene -> sample -> render locally -> score.
Work that does not depend on a query is done once per volume and kept.
"""

from neugrasp_ros.pipeline.planner import (
    DEFAULT_SUPPORT_HEIGHT,
    Decision,
    GraspPlanner,
)
from neugrasp_ros.pipeline.scenes import EncodedScene, RenderedScene
from neugrasp_ros.scene.workers import use_threads

__all__ = [
    "DEFAULT_SUPPORT_HEIGHT",
    "Decision",
    "EncodedScene",
    "GraspPlanner",
    "RenderedScene",
    "use_threads",
]
