# SPDX-License-Identifier: Apache-2.0
"""The pipeline of one process: stages are called, nothing is serialised."""

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import partial
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.nodes.depth_fusion import DepthFusion
from neugrasp_ros.nodes.detection import Stages
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.outcomes import Code, DetectionError
from neugrasp_ros.nodes.planner_stages import Box, EvaluatorStage, RendererStage, Staged
from neugrasp_ros.nodes.reach_stage import ReachStage
from neugrasp_ros.nodes.requests import SCENES, Wanted
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.nodes.waiting import Stop, never

Part = TypeVar("Part")


def loaded(part: Part | None) -> Part:
    """Return a stage that ``missing`` did not name."""
    assert part is not None
    return part


class LocalStages(Stages):
    """Stage objects of this process; those that still load are ``None``.

    Args:
        transforms: Looks up transforms.
    """

    def __init__(self, transforms: Transforms) -> None:
        self._transforms = transforms
        self.fusion: DepthFusion | None = None
        self.renderer: RendererStage | None = None
        self.evaluator: EvaluatorStage | None = None
        self.reach: ReachStage | None = None

    def missing(self) -> list[str]:
        """Return what is not ready yet, in words."""
        loading = "is still loading"
        parts = {
            "tsdf_fusion": self.fusion,
            "scene_renderer": self.renderer,
            "grasp_evaluator": self.evaluator,
            "reachability_filter": self.reach,
        }
        return [f"{name} {loading}" for name, part in parts.items() if part is None]

    def request(self) -> AbstractContextManager[None]:
        """Keep streams away from the planner."""
        return loaded(self.evaluator).request()

    def serves(self) -> bool:
        """Tell whether a request is running or about to go on."""
        return self.evaluator is not None and self.evaluator.serves()

    def labels(self, deadline: float) -> tuple[str, ...]:
        """Return the affordance classes."""
        return loaded(self.evaluator).labels

    def require_arms(self, arms: tuple[str, ...], deadline: float) -> None:
        """Refuse planning groups that the robot does not have."""
        loaded(self.reach).require_arms(arms)

    def frames(self) -> tuple[str, ...]:
        """Return the names of all known frames."""
        return self._transforms.frames()

    def scene(
        self,
        wanted: Wanted,
        newer_than: int,
        deadline: float,
        stop: Stop = never,
    ) -> SceneView:
        """Return a scene as fresh as wanted."""
        if wanted.scene == SCENES["reset"]:
            loaded(self.fusion).reset()
        view = loaded(self.fusion).wait(
            lambda v: (
                v.is_newer(newer_than) and v.volume.view_count >= wanted.min_views
            ),
            deadline if newer_than or wanted.min_views > 1 else time.monotonic(),
            stop,
        )
        require(view, wanted, newer_than)
        return view

    def sample(
        self, view: SceneView, roi: Box | None, wanted: Wanted, deadline: float
    ) -> Staged:
        """Propose candidates."""
        loaded(self.evaluator).remember(view)
        loaded(self.reach).remember(view)
        return loaded(self.renderer).sample(
            view, roi, wanted.max_candidates, wanted.seed
        )

    def begin_scores(
        self, grasps: GraspList, view: SceneView, deadline: float
    ) -> Callable[[], Staged]:
        """Return what scores candidates: nothing is gained by beginning at once."""
        return partial(loaded(self.evaluator).evaluate, grasps, view)

    def check(
        self, grasps: GraspList, arms: tuple[str, ...], deadline: float
    ) -> GraspList:
        """Check grasps against the robot."""
        return loaded(self.reach).check(grasps, arms)

    def suggest_base(
        self, grasps: GraspList, arms: tuple[str, ...], deadline: float
    ) -> tuple[str, NDArray[np.float64]] | None:
        """Return where the base would have to stand, and in which frame."""
        reach = loaded(self.reach)
        place = reach.suggest_base(grasps, arms)
        return None if place is None else (reach.base_frame, place)

    def transform(self, target: str, source: str, stamp: int) -> NDArray[np.float64]:
        """Return ``T_target_source``."""
        return self._transforms(target, source, stamp)


def require(view: SceneView, wanted: Wanted, newer_than: int) -> None:
    """Refuse a scene that is older, or holds fewer views, than wanted.

    Raises:
        DetectionError: TIMEOUT, with the numbers.
    """
    if not view.is_newer(newer_than):
        raise DetectionError(
            Code.TIMEOUT,
            f"no depth image newer than the request within {wanted.timeout} s",
        )
    if view.volume.view_count < wanted.min_views:
        raise DetectionError(
            Code.TIMEOUT,
            f"{view.volume.view_count} of {wanted.min_views} views within "
            f"{wanted.timeout} s; with view_mode latest there is never more than one",
        )
