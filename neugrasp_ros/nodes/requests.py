# SPDX-License-Identifier: Apache-2.0
"""Detection requests, checked: the service's and the action's are the same."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from neugrasp_msgs.srv import DetectGrasps

from neugrasp_ros.errors import ConfigError, DepthImageError
from neugrasp_ros.nodes.conversions import from_pose, from_stamp
from neugrasp_ros.nodes.outcomes import Code, DetectionError
from neugrasp_ros.nodes.planner_stages import Box
from neugrasp_ros.nodes.settings import ServerConfig
from neugrasp_ros.nodes.target_mask import Camera, Target, read_target

Request = DetectGrasps.Request

SCENES = {
    "current": Request.SCENE_CURRENT,
    "fresh": Request.SCENE_FRESH,
    "reset": Request.SCENE_RESET,
}
REACH_OFF, REACH_LAST, REACH_FIRST = (
    Request.REACH_OFF,
    Request.REACH_LAST,
    Request.REACH_FIRST,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """A request with the node's parameters in place of what it leaves open.

    Attributes:
        affordance: Query text.
        min_quality: Least probability of success.
        min_affordance: Least score of the query.
        max_grasps: Grasps to answer.
        max_candidates: Candidates to score.
        frame_id: Frame of the answer.
        roi: Region to look in, None = everywhere; its frame is ``roi_frame``.
        roi_frame: Frame that the region is given in.
        target: What the mask covers; None = everything.
        arms: Planning groups to try; empty = all.
        reachability: ``REACH_OFF``, ``REACH_LAST`` or ``REACH_FIRST``.
        scene: ``SCENE_*``.
        min_views: Views that the scene must hold.
        budget: Time after which the best so far is answered [s]; 0 = none.
        timeout: Time after which the request fails [s].
        seed: Of the candidates; 0 = draw one for each revision of the scene.
    """

    affordance: str
    min_quality: float
    min_affordance: float
    max_grasps: int
    max_candidates: int
    frame_id: str
    roi: Box | None
    roi_frame: str
    target: Target | None
    arms: tuple[str, ...]
    reachability: int
    scene: int
    min_views: int
    budget: float
    timeout: float
    seed: int


def read_request(
    request: Any,
    config: ServerConfig,
    camera: Camera | None = None,
    no_camera: str = "",
) -> Wanted:
    """Check a request of the service or the action.

    Args:
        request: The request.
        config: What stands for fields left open.
        camera: The depth camera that a mask belongs to, as far as it is known.
        no_camera: Why it is not known; empty = nothing has come yet.

    Raises:
        DetectionError: INVALID_REQUEST, naming the field; or NO_CAMERA_INFO.
    """
    try:
        return _read(request, config, read_target(request.mask, camera, no_camera))
    except (ConfigError, DepthImageError) as error:
        raise DetectionError(Code.INVALID_REQUEST, str(error)) from error


def _read(request: Any, config: ServerConfig, target: Target | None) -> Wanted:
    if request.reachability not in (REACH_OFF, REACH_LAST, REACH_FIRST):
        raise ConfigError(f"reachability must be 0, 1 or 2, got {request.reachability}")
    if request.scene not in SCENES.values():
        raise ConfigError(f"scene must be 0, 1 or 2, got {request.scene}")
    roi = read_roi(request)
    return Wanted(
        affordance=request.affordance,
        min_quality=_share(request, "min_quality", config.min_quality),
        min_affordance=_share(request, "min_affordance", config.min_affordance),
        max_grasps=request.max_grasps or config.max_grasps,
        max_candidates=_candidates(request.max_candidates or config.max_candidates),
        frame_id=request.frame_id or config.target_frame,
        roi=roi,
        roi_frame=request.roi_pose.header.frame_id or config.target_frame,
        target=target,
        arms=tuple(request.arms),
        reachability=request.reachability,
        scene=request.scene or SCENES[config.scene],
        min_views=request.min_views or config.min_views,
        budget=_seconds("time_budget", request.time_budget, 0.0),
        timeout=_seconds("timeout", request.timeout, config.timeout),
        seed=request.seed,
    )


def _share(request: Any, name: str, default: float) -> float:
    value = float(getattr(request, name))
    if value < 0:
        return default
    if not value <= 1.0:
        raise ConfigError(
            f"{name} must be within 0..1 (< 0: the parameter), got {value}"
        )
    return value


def _candidates(count: int) -> int:
    limit = ServerConfig.__dataclass_fields__["max_candidates"].metadata["range"][1]
    if count > limit:
        raise ConfigError(f"max_candidates must be at most {limit}, got {count}")
    return count


def _seconds(name: str, duration: Duration, default: float) -> float:
    value = from_stamp(duration) / 1e9
    if value < 0:
        raise ConfigError(f"{name} must not be negative, got {value} s")
    return value or default


def read_roi(request: Any) -> Box | None:
    """Return the box of ``roi_pose`` and ``roi_size``; None for no size at all.

    Raises:
        ConfigError: If the size is negative, not a number, or partly zero.
    """
    size = request.roi_size
    edges = np.array([size.x, size.y, size.z])
    if not np.isfinite(edges).all() or (edges < 0).any():
        raise ConfigError(
            f"roi_size must be positive, or all zero, got {edges.tolist()} m"
        )
    if not edges.any():
        return None
    if not edges.all():
        raise ConfigError(f"roi_size has a zero edge: {edges.tolist()} m")
    return Box(from_pose(request.roi_pose.pose, "roi_pose"), edges)
