# SPDX-License-Identifier: Apache-2.0
"""Node ``grasp_evaluator``: candidates into scored grasps."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from neugrasp_msgs.msg import GraspArray, GraspCandidates, TsdfVolume
from neugrasp_msgs.srv import EvaluateGrasps, ListAffordances
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import Executor
from rclpy.node import Node
from std_msgs.msg import String

from neugrasp_ros.config import PlannerConfig
from neugrasp_ros.grasp.queries import parse_query
from neugrasp_ros.nodes.conversions import (
    from_grasp_array,
    from_tsdf,
    to_grasp_array,
)
from neugrasp_ros.nodes.courtesy import Courtesy
from neugrasp_ros.nodes.grasp_list import joined
from neugrasp_ros.nodes.params import declare_config
from neugrasp_ros.nodes.planner_stages import EvaluatorStage
from neugrasp_ros.nodes.planners import MakePlanner, load_planner
from neugrasp_ros.nodes.qos import latched, newest, overrides
from neugrasp_ros.nodes.runtime import run
from neugrasp_ros.nodes.selection import (
    describe,
    rank_scores,
    ranked,
    with_query,
)
from neugrasp_ros.nodes.settings import EvaluatorConfig
from neugrasp_ros.nodes.work import LatestWorker, answer, shielded, to_timings

NAME = "grasp_evaluator"
VOLUME_WAIT = 2.0  # [s] that candidates wait for their volume
STREAM_BATCH = 64  # candidates for which a request has to wait at most


class GraspEvaluatorNode(Node):
    """Score candidates; loads the weights before it offers to."""

    def __init__(
        self, make_planner: MakePlanner = load_planner, **node_options: Any
    ) -> None:
        """Load the planner, then wire topics and services."""
        super().__init__(NAME, **node_options)
        self._config = declare_config(self, EvaluatorConfig)
        planner_config = declare_config(self, PlannerConfig, read_only=True).current
        self.stage = EvaluatorStage(make_planner(planner_config), self._config)
        self._courtesy = Courtesy(self.stage.let_requests_go_first)
        self._worker = LatestWorker(self, self._stream)
        self._scored = self.create_publisher(GraspArray, "grasps/scored", newest())
        self._vocabulary = self.create_publisher(String, "affordances", latched())
        self._vocabulary.publish(String(data=",".join(self.stage.labels)))
        inputs = MutuallyExclusiveCallbackGroup()
        self.create_subscription(
            TsdfVolume,
            "tsdf",
            shielded(self, lambda m: self.stage.remember(from_tsdf(m))),
            latched(),
            callback_group=inputs,
            qos_overriding_options=overrides(),
        )
        self.create_subscription(
            GraspCandidates,
            "grasps/candidates",
            self._on_candidates,
            newest(),
            callback_group=inputs,
        )
        services = ReentrantCallbackGroup()
        self.create_service(
            EvaluateGrasps, "~/evaluate", self._on_evaluate, callback_group=services
        )
        self.create_service(
            ListAffordances,
            "~/list_affordances",
            self._on_list,
            callback_group=services,
        )

    def _on_candidates(self, message: GraspCandidates) -> None:
        if self._config.current.streaming:
            self._worker.put(message.candidates)

    def _stream(self, candidates: GraspArray) -> None:
        """Publish the distinct candidates that are good enough, best first.

        If requests came first, and newer candidates with them, these are left. Where
        only a newer scene has come, its candidates are waited for.
        """
        config, grasps = self._config.current, from_grasp_array(candidates)
        view = self.stage.view_of(grasps, time.monotonic() + VOLUME_WAIT)
        parts = []

        def is_replaced(end: float) -> bool:
            return self._worker.has_next(end if self.stage.knows_newer(view) else 0.0)

        for start in range(0, max(len(grasps), 1), STREAM_BATCH):
            rows = np.arange(start, min(start + STREAM_BATCH, len(grasps)))
            self._courtesy.make_way(is_replaced)
            parts.append(self.stage.evaluate(grasps.take(rows), view).grasps)
        scored = joined(parts)
        good = scored.take(scored.grasps.quality >= config.min_quality)
        best = ranked(good, config)
        self._scored.publish(to_grasp_array(best))
        self._courtesy.published()

    def _on_evaluate(
        self, request: EvaluateGrasps.Request, response: EvaluateGrasps.Response
    ) -> object:
        def work() -> None:
            grasps = from_grasp_array(request.candidates.candidates)
            query = parse_query(request.affordance, self.stage.labels)
            view = self.stage.view_of(grasps, time.monotonic() + VOLUME_WAIT)
            if not len(grasps):  # somebody will ask about this volume soon
                self.stage.prepare(view)
            staged = self.stage.evaluate(grasps, view)
            scored = with_query(staged.grasps, query)
            order = rank_scores(scored, self._config.current).argsort()[::-1]
            info = replace(scored.info, stamp=view.stamp, revision=view.revision)
            response.grasps = to_grasp_array(replace(scored.take(order), info=info))
            response.message = to_timings(staged.seconds)

        with self.stage.request():
            return answer(self, response, work)

    def _on_list(
        self, _: ListAffordances.Request, response: ListAffordances.Response
    ) -> ListAffordances.Response:
        response.labels = list(self.stage.labels)
        response.descriptions = [describe(label) for label in self.stage.labels]
        return response

    def destroy_node(self) -> None:
        """End the worker, then the node."""
        self._worker.close()
        super().destroy_node()


def start(executor: Executor) -> Callable[[], None]:
    """Add the node to an executor; return what ends it."""
    node = GraspEvaluatorNode()
    executor.add_node(node)
    return node.destroy_node


def main(args: list[str] | None = None) -> int:
    """Run the node until shutdown."""
    return run(NAME, start, args)
