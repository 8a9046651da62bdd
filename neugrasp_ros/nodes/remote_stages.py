# SPDX-License-Identifier: Apache-2.0
"""The pipeline of several processes: stages are asked over their services."""

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
from neugrasp_msgs.msg import GraspArray, GraspCandidates
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
from neugrasp_ros.nodes.waiting import Stop, is_ending, never, wait_for
from neugrasp_ros.nodes.work import from_timings

LOOK_PERIOD = 0.05  # [s] after which an unchanged scene is looked at for its stamp
FIRST_PERIOD = 0.5  # [s] after which one that is not there is asked for again


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
        self._ends: Stop = lambda: is_ending(node)
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
        request = ListAffordances.Request()
        return tuple(call(self._list, request, deadline, self._ends).labels)

    def require_arms(self, arms: tuple[str, ...], deadline: float) -> None:
        """Refuse planning groups that the robot does not have."""
        request = CheckReachability.Request(arms=list(arms))
        request.grasps.header.frame_id = "any"  # there is no grasp to look up
        _good(call(self._check, request, deadline, self._ends))

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
            _good(call(self._reset, Trigger.Request(), deadline, stop))
        patient = bool(newer_than) or wanted.min_views > 1
        problem: DetectionError | None = None
        patience = 0.0  # [s] that the volume may be waited for, at first none
        request = GetTsdf.Request()
        while True:
            if stop():  # a call that is answered at once does not ask
                raise DetectionError(
                    Code.CANCELED, "canceled while it waited for a depth image"
                )
            start = time.monotonic()
            left = deadline - start - LOOK_PERIOD
            last = not patient or left <= 0
            request.timeout.nanosec = int(1e9 * max(min(patience, left), 0.0))
            try:
                response = call(self._tsdf, request, deadline, stop)
            except DetectionError as error:
                if error.code is Code.CANCELED:
                    raise
                raise problem or error from None
            if response.success:
                problem, patience = None, LOOK_PERIOD
                seconds = from_timings(response.message).get("fusion", 0.0)
                view = replace(from_tsdf(response.volume), seconds=seconds)
                request.min_revision = view.revision + 1
                enough = view.volume.view_count >= wanted.min_views
                if last or (view.is_newer(newer_than) and enough):
                    require(view, wanted, newer_than)
                    return view
            else:
                problem = from_message(response.message)
                if last:
                    raise problem
                if patience:  # it may have failed at once
                    time.sleep(max(start + LOOK_PERIOD - time.monotonic(), 0.0))
                request.min_revision, patience = 0, FIRST_PERIOD

    def sample(
        self, view: SceneView, roi: Box | None, wanted: Wanted, deadline: float
    ) -> Staged:
        """Propose candidates, while the evaluator already encodes the scene."""
        self._evaluate.call_async(_about(view))
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
        response = _good(call(self._sample, request, deadline, self._ends))
        grasps = from_grasp_array(response.candidates.candidates)
        seconds = from_timings(response.message)
        info = replace(grasps.info, stamp=view.stamp)
        sampled = int(seconds.pop("sampled", len(grasps)))
        return Staged(replace(grasps, info=info), seconds, sampled)

    def begin_scores(
        self, grasps: GraspList, view: SceneView, deadline: float
    ) -> Callable[[], Staged]:
        """Ask for candidates' scores; they come back in their order."""
        candidates = GraspCandidates(candidates=to_grasp_array(grasps))
        request = EvaluateGrasps.Request(candidates=candidates)
        wait = begin(self._evaluate, request)

        def scores() -> Staged:
            response = _good(wait(deadline, self._ends))
            scored = from_grasp_array(response.grasps)
            row = {name: i for i, name in enumerate(scored.grasps.ids)}
            order = np.array([row[name] for name in grasps.grasps.ids], dtype=np.int64)
            info = replace(scored.info, stamp=grasps.info.stamp)
            ordered = replace(scored.take(order), info=info, reach=grasps.reach)
            return Staged(ordered, from_timings(response.message))

        return scores

    def check(
        self, grasps: GraspList, arms: tuple[str, ...], deadline: float
    ) -> GraspList:
        """Check grasps against the robot."""
        request = CheckReachability.Request(
            grasps=to_grasp_array(grasps), arms=list(arms)
        )
        response = _good(call(self._check, request, deadline, self._ends))
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
            response = _good(call(self._suggest, request, deadline, self._ends))
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


def _about(view: SceneView) -> EvaluateGrasps.Request:
    """Return a question without candidates, at which the evaluator encodes a scene."""
    array = GraspArray(scene_revision=view.revision)
    array.header.frame_id = view.frame_id
    return EvaluateGrasps.Request(candidates=GraspCandidates(candidates=array))


def call(client: Client, request: Any, deadline: float, stop: Stop) -> Any:
    """Call a service and wait for its answer; raises as what ``begin`` returns."""
    return begin(client, request)(deadline, stop)


def begin(client: Client, request: Any) -> Callable[[float, Stop], Any]:
    """Call a service; its answer is waited for later.

    Returns:
        Takes a deadline of ``time.monotonic()`` and what says whether to stop, and
        waits for the answer, not in the executor's only thread; raises
        ``DetectionError`` TIMEOUT at the deadline and CANCELED where it is stopped.
    """
    done = threading.Event()
    future = client.call_async(request)
    future.add_done_callback(lambda _: done.set())

    def wait(deadline: float, stop: Stop) -> Any:
        if wait_for(done, deadline, stop):
            return future.result()
        client.remove_pending_request(future)
        name = client.srv_name
        if time.monotonic() < deadline:
            raise DetectionError(Code.CANCELED, f"canceled while {name} worked")
        raise DetectionError(Code.TIMEOUT, f"no answer from {name} in time")

    return wait


def _good(response: Any) -> Any:
    """Return a response that succeeded.

    Raises:
        DetectionError: With the code and sentence of one that did not.
    """
    if not response.success:
        raise from_message(response.message)
    return response
