# SPDX-License-Identifier: Apache-2.0
"""What ``scene_renderer`` and ``grasp_evaluator`` do, without their topics.

In a composed process both hold the same planner, so that a volume is encoded once.
"""

import threading
import time
from collections import OrderedDict
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import RevisionError
from neugrasp_ros.fusion.tsdf import seen_surface
from neugrasp_ros.geometry.support import ABOVE_SUPPORT
from neugrasp_ros.geometry.transform import apply, invert
from neugrasp_ros.grasp.types import GraspSet
from neugrasp_ros.nodes.grasp_list import (
    STAGE_CANDIDATES,
    STAGE_SCORED,
    GraspInfo,
    GraspList,
)
from neugrasp_ros.nodes.outcomes import Code, DetectionError
from neugrasp_ros.nodes.params import LiveConfig
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.settings import EvaluatorConfig, RendererConfig
from neugrasp_ros.nodes.shared_planner import SharedPlanner

FloatArray = NDArray[np.float64]

LEAST_POINTS = 20  # seen surface points that make something to look at


class Box(NamedTuple):
    """A region to look in: pose of its centre in a frame (4, 4), full edges (3,)."""

    T_frame_box: FloatArray
    size: FloatArray


@dataclass(frozen=True, slots=True)
class Staged:
    """What a stage gave: the grasps, and the seconds of its parts by name."""

    grasps: GraspList
    seconds: dict[str, float]
    sampled: int = 0


class RendererStage:
    """Encodes and renders a scene, and samples candidates on its surface.

    Args:
        shared: The planner.
        config: Live configuration.
    """

    def __init__(
        self, shared: SharedPlanner, config: LiveConfig[RendererConfig]
    ) -> None:
        self._shared = shared
        self._config = config
        self._drawn = (-1, 0)  # revision, seed

    def sample(
        self, view: SceneView, roi: Box | None, max_candidates: int, seed: int
    ) -> Staged:
        """Propose grasps in a scene.

        Args:
            view: The scene.
            roi: Region in the scene's frame to propose grasps in; None = everywhere.
            max_candidates: How many at most.
            seed: Of the random choices; 0 draws one for each revision of the scene, so
                that what was proposed and scored for it is used again.

        Raises:
            DetectionError: If the region, or the whole workspace, is empty.
        """
        config, planner = self._config.current, self._shared.planner
        require_surface(view, roi, config.support_height)
        with self._shared.timed() as seconds:
            scene = self._shared.encode(view, config.support_height)
            grasps = planner.sample(
                scene,
                support_height=config.support_height,
                roi=_bounds(invert(view.T_frame_task), roi) if roi else None,
                max_candidates=max_candidates,
                seed=seed or self._seed_of(view.revision),
            )
            contacts = planner.contacts(scene, grasps)
        info = self.nothing(view).grasps.info
        found = GraspList(info, grasps, contacts=contacts)
        found = found.moved(view.T_frame_task, view.frame_id)
        inside = in_box(found.grasps.poses[:, :3, 3], roi)
        return Staged(found.take(inside), seconds, sampled=len(grasps))

    def _seed_of(self, revision: int) -> int:
        """Return the seed that was drawn for a revision; draw one for a new one."""
        if self._drawn[0] != revision:
            self._drawn = revision, int(np.random.default_rng().integers(1, 2**31))
        return self._drawn[1]

    def nothing(self, view: SceneView) -> Staged:
        """Return an empty list of candidates of a scene."""
        config = self._config.current
        info = GraspInfo(
            frame_id=view.frame_id,
            stamp=view.stamp,
            axes=config.axes,
            stage=STAGE_CANDIDATES,
            gripper=self._shared.gripper,
            tcp_frame=config.tcp_frame,
            labels=self._shared.planner.affordances,
            revision=view.revision,
        )
        return Staged(GraspList(info, GraspSet(np.zeros((0, 4, 4)), np.zeros(0))), {})

    def let_requests_go_first(self, end: float) -> bool:
        """Wait for running requests; called by streams.

        Args and result are those of ``SharedPlanner.wait_for_requests``.
        """
        return self._shared.wait_for_requests(end)

    def request(self) -> AbstractContextManager[None]:
        """Return what keeps streams away while a request runs."""
        return self._shared.request()

    def prepare(self, view: SceneView) -> None:
        """Encode a scene, and no more: a request that comes meanwhile gains by it.

        Raises:
            DetectionError: As ``sample``, without a region.
        """
        support = self._config.current.support_height
        require_surface(view, None, support)
        with self._shared.timed():
            self._shared.encode(view, support)

    def surface(self, view: SceneView) -> FloatArray:
        """Return the completed surface in the scene's frame: x, y, z, normal (N, 6)."""
        support = self._config.current.support_height
        with self._shared.timed():
            scene = self._shared.encode(view, support)
            rendered = self._shared.planner.render(scene)
        points = apply(view.T_frame_task, rendered.points)
        normals = rendered.normals @ view.T_frame_task[:3, :3].T
        return np.hstack([points, normals])


def require_surface(view: SceneView, roi: Box | None, support: float) -> None:
    """Refuse a scene in which nothing stands on the support.

    Args:
        view: The scene.
        roi: Region in the scene's frame; None = everywhere.
        support: Height of the support plane in the task frame in [m].

    Raises:
        DetectionError: EMPTY_WORKSPACE, saying whether nothing is there or nothing
            was measured.
    """
    volume = view.volume
    if not volume.observed.any():
        raise DetectionError(
            Code.EMPTY_WORKSPACE,
            "nothing inside the workspace was measured: the camera does not look "
            "into it, or its pixels there are invalid",
        )
    points, _ = seen_surface(volume)
    points = points[points[:, 2] > support + ABOVE_SUPPORT]
    points = apply(view.T_frame_task, points)
    points = points[in_box(points, roi)]
    if len(points) < LEAST_POINTS:
        where = "workspace" if roi is None else "region of interest"
        raise DetectionError(
            Code.EMPTY_WORKSPACE,
            f"the {where} is empty: no surface was seen in it above the support at "
            f"{support:.3f} m",
        )


def in_box(points: FloatArray, roi: Box | None) -> NDArray[np.bool_]:
    """Tell which points (N, 3) of the box's frame are in the box; None = all."""
    if roi is None or not len(points):
        return np.ones(len(points), dtype=bool)
    local = np.abs(apply(invert(roi.T_frame_box), points))
    return np.asarray((local <= roi.size / 2).all(axis=1))


def _bounds(T_task_frame: FloatArray, roi: Box) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper corner of a box, as seen from the task frame."""
    signs = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T
    corners = apply(T_task_frame @ roi.T_frame_box, signs * roi.size)
    return corners.min(axis=0), corners.max(axis=0)


class EvaluatorStage:
    """Scores grasps in the volume that they were made for.

    Args:
        shared: The planner.
        config: Live configuration.
    """

    def __init__(
        self, shared: SharedPlanner, config: LiveConfig[EvaluatorConfig]
    ) -> None:
        self._shared = shared
        self._config = config
        self._views: OrderedDict[int, SceneView] = OrderedDict()
        self._arrived = threading.Condition()

    def let_requests_go_first(self, end: float) -> bool:
        """Wait for running requests; called by streams.

        Args and result are those of ``SharedPlanner.wait_for_requests``.
        """
        return self._shared.wait_for_requests(end)

    def serves(self) -> bool:
        """Tell whether a request is running or about to go on."""
        return self._shared.serves()

    def request(self) -> AbstractContextManager[None]:
        """Return what keeps streams away while a request runs."""
        return self._shared.request()

    def prepare(self, view: SceneView) -> None:
        """Get ready to score in a scene; nothing to do if nothing was measured."""
        if view.volume.observed.any():
            self._shared.prepare(view, self._config.current.support_height)

    @property
    def labels(self) -> tuple[str, ...]:
        """Affordance classes that the weights know."""
        return self._shared.planner.affordances

    def remember(self, view: SceneView) -> None:
        """Keep a volume for candidates that refer to it."""
        with self._arrived:
            self._views[view.revision] = view
            self._views.move_to_end(view.revision)
            while len(self._views) > self._config.current.kept_revisions:
                self._views.popitem(last=False)
            self._arrived.notify_all()

    def knows_newer(self, view: SceneView) -> bool:
        """Tell whether a volume of a later revision has come."""
        with self._arrived:
            return max(self._views, default=0) > view.revision

    def view_of(self, grasps: GraspList, deadline: float) -> SceneView:
        """Return the volume that grasps were made for; revision 0 = the newest.

        Args:
            grasps: The grasps.
            deadline: Of ``time.monotonic()`` until which the volume may come.

        Raises:
            RevisionError: If another volume is at hand, or none.
        """
        wanted = grasps.info.revision
        with self._arrived:
            while True:
                if self._views and not wanted:
                    return self._views[max(self._views)]
                if wanted in self._views:
                    return self._views[wanted]
                left = deadline - time.monotonic()
                if left <= 0:
                    break
                self._arrived.wait(left)
            known = ", ".join(map(str, self._views)) or "none"
        raise RevisionError(
            f"the candidates are of scene revision {wanted}, at hand: {known}; "
            "sample again"
        )

    def evaluate(self, grasps: GraspList, view: SceneView) -> Staged:
        """Score grasps and fill in missing contacts; ids and order stay.

        Raises:
            DetectionError: If the grasps are given in another frame than the volume.
        """
        info = grasps.info
        if info.frame_id != view.frame_id:
            raise DetectionError(
                Code.TF_ERROR,
                f"grasps are in {info.frame_id!r}, the scene is in {view.frame_id!r}; "
                f"send them in {view.frame_id!r}",
            )
        in_task = replace(
            grasps.grasps, poses=invert(view.T_frame_task) @ grasps.grasps.poses
        )
        planner = self._shared.planner
        if not len(grasps):
            return Staged(replace(grasps, info=replace(info, stage=STAGE_SCORED)), {})
        support = self._config.current.support_height
        with self._shared.timed() as seconds:
            scene = self._shared.encode(view, support)
            scored = planner.evaluate(scene, in_task, support_height=support)
            contacts = grasps.contacts.copy()
            missing = np.flatnonzero(np.isnan(contacts).any(axis=(1, 2)))
            found = planner.contacts(scene, in_task.take(missing))
            contacts[missing] = apply(view.T_frame_task, found)
        scored = replace(scored, poses=grasps.grasps.poses)
        info = replace(info, stage=STAGE_SCORED, labels=planner.affordances)
        done = replace(grasps, info=info, grasps=scored, contacts=contacts)
        return Staged(done, seconds)
