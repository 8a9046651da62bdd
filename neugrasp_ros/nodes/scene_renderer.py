# SPDX-License-Identifier: Apache-2.0
"""Node ``scene_renderer``: a TSDF into a completed surface and grasp candidates."""

import threading
from collections.abc import Callable
from typing import Any

from neugrasp_msgs.msg import GraspCandidates, TsdfVolume
from neugrasp_msgs.srv import SampleGrasps
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.errors import EmptySceneError, RevisionError
from neugrasp_ros.nodes.compat.clouds import write_cloud
from neugrasp_ros.nodes.conversions import (
    from_tsdf,
    to_grasp_array,
    to_stamp,
)
from neugrasp_ros.nodes.courtesy import Courtesy
from neugrasp_ros.nodes.outcomes import Code, DetectionError
from neugrasp_ros.nodes.params import declare_config
from neugrasp_ros.nodes.planner_stages import RendererStage, Staged
from neugrasp_ros.nodes.planners import MakePlanner, load_planner
from neugrasp_ros.nodes.qos import latched, newest, overrides
from neugrasp_ros.nodes.requests import read_roi
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.settings import RendererConfig
from neugrasp_ros.nodes.work import LatestWorker, answer, shielded, to_timings

NAME = "scene_renderer"
VOLUME_WAIT = 5.0  # [s] that a request waits for the revision it names


class SceneRendererNode(Node):
    """Render scenes and sample candidates; loads the weights before it offers them."""

    def __init__(
        self, make_planner: MakePlanner = load_planner, **node_options: Any
    ) -> None:
        """Load the planner, then wire topics and services."""
        super().__init__(NAME, **node_options)
        self._config = declare_config(self, RendererConfig)
        self._planner = declare_config(self, PlannerConfig, read_only=True).current
        self.stage = RendererStage(make_planner(self._planner), self._config)
        self._courtesy = Courtesy(self.stage.let_requests_go_first)
        self._view: SceneView | None = None
        self._arrived = threading.Condition()
        self._worker = LatestWorker(
            self, self._stream, lambda: self._config.current.min_period
        )
        self._candidates = self.create_publisher(
            GraspCandidates, "grasps/candidates", newest()
        )
        self._surface = self.create_publisher(
            PointCloud2, "rendered_cloud", latched(), qos_overriding_options=overrides()
        )
        self.create_subscription(
            TsdfVolume,
            "tsdf",
            shielded(self, self._on_tsdf),
            latched(),
            callback_group=MutuallyExclusiveCallbackGroup(),
            qos_overriding_options=overrides(),
        )
        self.create_service(
            SampleGrasps,
            "~/sample",
            self._on_sample,
            callback_group=ReentrantCallbackGroup(),
        )

    def _on_tsdf(self, message: TsdfVolume) -> None:
        with self._arrived:
            self._view = from_tsdf(message)
            self._arrived.notify_all()
        if self._config.current.streaming:
            self._worker.put(self._view)

    def _stream(self, view: SceneView) -> None:
        """Publish candidates and surface; an empty scene gives an empty list.

        Requests need not wait for more than one of its steps. If one came first, and a
        newer scene with it, that one's turn has come: this one is left.
        """
        config = self._config.current

        def make_way() -> None:
            self._courtesy.make_way(lambda _: self._worker.has_next())

        make_way()
        try:
            self.stage.prepare(view)
            make_way()
            staged = self.stage.sample(
                view, None, self._planner.max_candidates, config.seed
            )
            self._candidates.publish(_message(staged))
        except (DetectionError, EmptySceneError):
            self._candidates.publish(_message(self.stage.nothing(view)))
            self._courtesy.published()
            return
        self._courtesy.published()
        make_way()
        self._surface.publish(
            write_cloud(self.stage.surface(view), view.frame_id, to_stamp(view.stamp))
        )

    def _on_sample(
        self, request: SampleGrasps.Request, response: SampleGrasps.Response
    ) -> object:
        def work() -> None:
            view = self._view_of(request.min_revision)
            roi = read_roi(request)
            frame = request.roi_pose.header.frame_id or view.frame_id
            if roi is not None and frame != view.frame_id:
                raise DetectionError(
                    Code.TF_ERROR,
                    f"roi_pose is in {frame!r}; send it in {view.frame_id!r}",
                )
            staged = self.stage.sample(
                view,
                roi,
                request.max_candidates or self._planner.max_candidates,
                request.seed,
            )
            response.candidates = _message(staged)
            response.message = to_timings(staged.seconds, sampled=staged.sampled)

        with self.stage.request():
            return answer(self, response, work)

    def _view_of(self, revision: int) -> SceneView:
        """Return a volume of at least the given revision, waiting for it a while."""
        with self._arrived:
            self._arrived.wait_for(
                lambda: self._view is not None and self._view.revision >= revision,
                timeout=VOLUME_WAIT,
            )
            if self._view is None:
                raise DetectionError(Code.NO_DEPTH, "no tsdf has come yet")
            if self._view.revision < revision:
                raise RevisionError(
                    f"scene revision {revision} has not come, at hand: "
                    f"{self._view.revision}"
                )
            return self._view

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        self._worker.close()
        super().destroy_node()


def _message(staged: Staged) -> GraspCandidates:
    return GraspCandidates(candidates=to_grasp_array(staged.grasps))


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = SceneRendererNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args)
