# SPDX-License-Identifier: Apache-2.0
"""The pipeline of several processes: stages are asked over their services."""

import threading
import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
from neugrasp_msgs.msg import GraspCandidates
from neugrasp_msgs.srv import (
    CheckReachability,
    EvaluateGrasps,
    GetTsdf,
    ListAffordances,
    SampleGrasps,
)
from numpy.typing import NDArray
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.node import Node
from std_srvs.srv import Trigger

from neugrasp_ros.nodes.conversions import (
    from_grasp_array,
    from_pose,
    from_tsdf,
    to_grasp_array,
    to_pose,
    to_stamp,
)
from neugrasp_ros.nodes.detection import Stages
from neugrasp_ros.nodes.grasp_list import GraspList
from neugrasp_ros.nodes.local_stages import require
from neugrasp_ros.nodes.outcomes import Code, DetectionError, from_message
from neugrasp_ros.nodes.planner_stages import Box, Staged
from neugrasp_ros.nodes.requests import SCENES, Wanted
from neugrasp_ros.nodes.scene_view import SceneView
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.nodes.work import from_timings

LOOK_PERIOD = 0.05  # [s] between two looks for a newer volume


class RemoteStages(Stages):
    """Service clients of the stage nodes.

    Args:
        node: Node that the clients belong to; its executor needs a spare thread.
        transforms: Looks up transforms.
    """

    def __init__(self, node: Node, transforms: Transforms) -> None:
        group = ReentrantCallbackGroup()

        def client(kind: type, name: str) -> Client:
            return node.create_client(kind, name, callback_group=group)

        self._transforms, self._log = transforms, node.get_logger()
        self._reset = client(Trigger, "tsdf_fusion/reset")
        self._tsdf = client(GetTsdf, "tsdf_fusion/get_tsdf")
        self._sample = client(SampleGrasps, "scene_renderer/sample")
        self._evaluate = client(EvaluateGrasps, "grasp_evaluator/evaluate")
        self._list = client(ListAffordances, "grasp_evaluator/list_affordances")
        self._check = client(CheckReachability, "reachability_filter/check")
        self._suggest = client(CheckReachability, "reachability_filter/suggest_base")

    def missing(self) -> list[str]:
        """Return what is not ready yet, in words."""
        nodes = {
            "tsdf_fusion": self._tsdf,
            "scene_renderer": self._sample,
            "grasp_evaluator": self._evaluate,
            "reachability_filter": self._check,
        }
        return [
            f"{name} does not offer its service (yet)"
            for name, client in nodes.items()
            if not client.service_is_ready()
        ]

    def request(self) -> AbstractContextManager[None]:
        """Hold nothing: the stages are other processes."""
        return nullcontext()

    def labels(self, deadline: float) -> tuple[str, ...]:
        """Return the affordance classes."""
        return tuple(call(self._list, ListAffordances.Request(), deadline).labels)

    def require_arms(self, arms: tuple[str, ...], deadline: float) -> None:
        """Refuse planning groups that the robot does not have."""
        request = CheckReachability.Request(arms=list(arms))
        request.grasps.header.frame_id = "any"  # there is no grasp to look up
        _good(call(self._check, request, deadline))

    def frames(self) -> tuple[str, ...]:
        """Return the names of all known frames."""
        return self._transforms.frames()

    def scene(self, wanted: Wanted, newer_than: int, deadline: float) -> SceneView:
        """Return a scene as fresh as wanted."""
        if wanted.scene == SCENES["reset"]:
            _good(call(self._reset, Trigger.Request(), deadline))
        patient = bool(newer_than) or wanted.min_views > 1
        problem: DetectionError | None = None
        while True:
            last = not patient or time.monotonic() + LOOK_PERIOD > deadline
            start = time.perf_counter()
            try:
                response = call(self._tsdf, GetTsdf.Request(), deadline)
            except DetectionError as late:
                raise problem or late from None
            if response.success:
                problem = None
                view = from_tsdf(response.volume)
                view = replace(view, seconds=time.perf_counter() - start)
                enough = view.volume.view_count >= wanted.min_views
                if last or (view.is_newer(newer_than) and enough):
                    require(view, wanted, newer_than)
                    return view
            else:
                problem = from_message(response.message)
                if last:
                    raise problem
            time.sleep(LOOK_PERIOD)  # the volume comes at the camera's rate

    def sample(
        self, view: SceneView, roi: Box | None, wanted: Wanted, deadline: float
    ) -> Staged:
        """Propose candidates."""
        request = SampleGrasps.Request(
            min_revision=view.revision,
            max_candidates=wanted.max_candidates,
            seed=wanted.seed,
        )
        request.roi_pose.header.frame_id = view.frame_id
        if roi is not None:
            request.roi_pose.header.stamp = to_stamp(view.stamp)
            request.roi_pose.pose = to_pose(roi.T_frame_box)
            for axis, edge in zip("xyz", roi.size.tolist(), strict=True):
                setattr(request.roi_size, axis, edge)
        response = _good(call(self._sample, request, deadline))
        grasps = from_grasp_array(response.candidates.candidates)
        seconds = from_timings(response.message)
        info = replace(grasps.info, stamp=view.stamp)
        sampled = int(seconds.pop("sampled", len(grasps)))
        return Staged(replace(grasps, info=info), seconds, sampled)

    def evaluate(self, grasps: GraspList, view: SceneView, deadline: float) -> Staged:
        """Score candidates; they come back in their order."""
        candidates = GraspCandidates(candidates=to_grasp_array(grasps))
        request = EvaluateGrasps.Request(candidates=candidates)
        response = _good(call(self._evaluate, request, deadline))
        scored = from_grasp_array(response.grasps)
        row = {name: i for i, name in enumerate(scored.grasps.ids)}
        order = np.array([row[name] for name in grasps.grasps.ids], dtype=np.int64)
        info = replace(scored.info, stamp=grasps.info.stamp)
        ordered = replace(scored.take(order), info=info, reach=grasps.reach)
        return Staged(ordered, from_timings(response.message))

    def check(
        self, grasps: GraspList, arms: tuple[str, ...], deadline: float
    ) -> GraspList:
        """Check grasps against the robot."""
        request = CheckReachability.Request(
            grasps=to_grasp_array(grasps), arms=list(arms)
        )
        response = _good(call(self._check, request, deadline))
        return from_grasp_array(response.grasps)

    def suggest_base(
        self, grasps: GraspList, arms: tuple[str, ...], deadline: float
    ) -> tuple[str, NDArray[np.float64]] | None:
        """Return where the base would have to stand, and in which frame."""
        if not self._suggest.service_is_ready():
            return None
        request = CheckReachability.Request(
            grasps=to_grasp_array(grasps), arms=list(arms)
        )
        try:
            response = _good(call(self._suggest, request, deadline))
        except DetectionError as error:  # of a hint only, so the list is still good
            self._log.warning(f"no place for the base is suggested: {error}")
            return None
        places = response.grasps.grasps
        if not places:
            return None
        return response.grasps.header.frame_id, from_pose(places[0].pose)

    def transform(self, target: str, source: str, stamp: int) -> NDArray[np.float64]:
        """Return ``T_target_source``."""
        return self._transforms(target, source, stamp)


def call(client: Client, request: Any, deadline: float) -> Any:
    """Call a service and wait for its answer, not in the executor's only thread.

    Raises:
        DetectionError: TIMEOUT at the deadline of ``time.monotonic()``.
    """
    done = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: done.set())
    if not done.wait(max(deadline - time.monotonic(), 0.0)):
        client.remove_pending_request(future)
        raise DetectionError(Code.TIMEOUT, f"no answer from {client.srv_name} in time")
    return future.result()


def _good(response: Any) -> Any:
    """Return a response that succeeded.

    Raises:
        DetectionError: With the code and sentence of one that did not.
    """
    if not response.success:
        raise from_message(response.message)
    return response
