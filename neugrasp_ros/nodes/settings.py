# SPDX-License-Identifier: Apache-2.0
"""Every parameter of the nodes, with its default, meaning and range."""

import math
from dataclasses import dataclass, field
from typing import Any

from neugrasp_ros.config import Checked, option
from neugrasp_ros.errors import ConfigError
from neugrasp_ros.grasp.queries import KNOWN_FROM
from neugrasp_ros.manipulation.settings import ExecutorConfig, MoverConfig
from neugrasp_ros.nodes.params import fixed
from neugrasp_ros.robot.settings import IkConfig, ReachabilityConfig

Triple = tuple[float, float, float]

DEFAULT_SUPPORT_HEIGHT = 0.05  # [m], as the scenes that the network learned from
MAX_REACH = 100.0  # [m]; a workspace further from its frame is a slip of units


def part(config_type: type, doc: str) -> Any:
    """Declare a nested configuration, whose parameters get a dotted prefix."""
    return field(default_factory=config_type, metadata={"doc": doc})


@dataclass(frozen=True, kw_only=True)
class WorkspaceConfig(Checked):
    """The cube in which grasps are sought; its lower corner is the task frame."""

    frame: str = option("base_footprint", "TF frame that the workspace is given in")
    origin: Triple = option((0.4, -0.15, 0.65), "Lower corner in that frame [m]")
    rpy: Triple = option((0.0, 0.0, 0.0), "Its roll, pitch, yaw [rad]")
    size: Triple = fixed(option((0.3, 0.3, 0.3), "Edges along x, y, z [m]"))
    find: bool = option(
        False,
        "Find the table in the first image, in a frame whose z is up, and put the "
        "workspace around what stands on it; origin, rpy and size are not used",
    )

    def __post_init__(self) -> None:
        """Reject a workspace that cannot be.

        Raises:
            ConfigError: If a number is absurd or the frame is empty.
        """
        super().__post_init__()
        if not self.frame:
            raise ConfigError("workspace.frame must not be empty")
        if not all(abs(v) <= MAX_REACH for v in self.origin):
            raise ConfigError(
                f"workspace.origin must be within {MAX_REACH} m, got {self.origin}"
            )
        if not all(abs(v) <= 2 * math.pi for v in self.rpy):
            raise ConfigError(f"workspace.rpy is in [rad], got {self.rpy}")
        if not all(0.1 <= v <= 2.0 for v in self.size):
            raise ConfigError(f"workspace.size must be in [0.1, 2] m, got {self.size}")

    def voxels(self, edge: float) -> tuple[int, int, int]:
        """Return the number of voxels along x, y and z, each of ``edge`` in [m]."""
        x, y, z = (round(v / edge) for v in self.size)
        return x, y, z


@dataclass(frozen=True, kw_only=True)
class FusionConfig(Checked):
    """Parameters of ``tsdf_fusion``."""

    view_mode: str = option(
        "latest", "Keep the newest view only, or fuse views", choices=("latest", "fuse")
    )
    workspace: WorkspaceConfig = part(WorkspaceConfig, "Workspace")
    voxel_size: float = fixed(option(0.0046875, "Voxel edge [m]", 0.002, 0.02))
    truncation_voxels: float = option(
        4.0, "Truncation [voxel]; the shipped network reads 4 alone", 1.0, 20.0
    )
    max_weight: int = option(
        16, "Views that a fused voxel remembers; few = quick to change", 1, 255
    )
    min_depth: float = option(0.3, "Nearer is not measured [m]", 0.0, 5.0)
    max_depth: float = option(3.0, "Further is not measured [m]", 0.1, 20.0)
    max_depth_age: float = option(
        1.0, "Older depth is refused [s]; 0 = never", 0.0, 60.0
    )
    tf_timeout: float = option(0.2, "How long an image waits for its TF [s]", 0.0, 5.0)
    tf_queue: int = option(10, "How many images wait for their TF", 1, 100)
    max_rate: float = option(10.0, "Images fused per second [Hz]", 0.1, 60.0)
    publish_rate: float = option(
        2.0, "Most volumes published per second [Hz]; 0 = none", 0.0, 30.0
    )
    min_motion: float = option(
        0.0,
        "Where views are fused, those whose camera hardly moved since the last one add "
        "nothing, not even what changed: least way [m]; 0 = all are fused",
        0.0, 1.0,
    )  # fmt: skip
    min_turn_deg: float = option(
        5.0, "A camera that turned so far has moved, too [deg]", 0.1, 180.0
    )
    integrating: bool = option(True, "Take new images")
    scene_path: str = fixed(
        option("", "File of ~/save and ~/load, ending in .npz; empty = refused")
    )
    carve_infinite: bool = option(False, "+Inf depth is free space up to max_depth")
    invalid_border: int = option(0, "Image border not used [pixel]", 0, 50)

    def __post_init__(self) -> None:
        """Check the depth range.

        Raises:
            ConfigError: If it is empty, or another value is out of range.
        """
        super().__post_init__()
        if not self.max_depth > self.min_depth:
            raise ConfigError(
                f"max_depth must be above min_depth, got {self.max_depth} and "
                f"{self.min_depth} m"
            )


@dataclass(frozen=True, kw_only=True)
class StreamConfig(Checked):
    """Whether a node reacts to every new input by itself, and how often."""

    streaming: bool = option(True, "React to every new input without being asked")
    min_period: float = option(
        0.5, "Least time from one reaction to the next [s]", 0.0, 60.0
    )
    seed: int = option(
        1,
        "Seed of the candidates; 0 = one for each revision of the scene",
        0,
        2**31 - 1,
    )


@dataclass(frozen=True, kw_only=True)
class PublishConfig(Checked):
    """How grasps are published."""

    axes: int = option(
        0,
        "Axes of published poses: 0 x-approach y-closing, 1 z-approach y-closing, "
        "2 z-approach x-closing",
        0, 2,
    )  # fmt: skip
    tcp_frame: str = option("gripper_left_tcp", "TF frame to bring onto a grasp pose")


@dataclass(frozen=True, kw_only=True)
class NmsConfig(Checked):
    """When two grasps count as one."""

    distance: float = option(0.02, "Nearer grasps may be the same [m]", 0.0, 0.2)
    angle_deg: float = option(20.0, "And turned less than this [deg]", 0.0, 180.0)


@dataclass(frozen=True, kw_only=True)
class SelectionConfig(Checked):
    """Which scored grasps are answered, in which order."""

    min_quality: float = option(0.5, "Least probability of success", 0.0, 1.0)
    min_affordance: float = option(
        KNOWN_FROM, "Least score of the queried one", 0.0, 1.0
    )
    rank_by: str = option(
        "quality*affordance",
        "What is best",
        choices=("quality", "affordance", "quality*affordance", "height"),
    )
    affordance_weight: float = option(
        1.0, "Exponent of the affordance in quality*affordance; 0 = quality", 0.0, 10.0
    )
    nms: NmsConfig = part(NmsConfig, "When two grasps count as one")


@dataclass(frozen=True, kw_only=True)
class SupportConfig(Checked):
    """Where the things to grasp stand."""

    support_height: float = option(
        DEFAULT_SUPPORT_HEIGHT,
        "Height of the table in the workspace [m]; the hand keeps off it",
        0.0, 2.0,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class RendererConfig(StreamConfig, PublishConfig, SupportConfig):
    """Parameters of ``scene_renderer`` beside those of the planner."""


@dataclass(frozen=True, kw_only=True)
class EvaluatorConfig(SelectionConfig, SupportConfig):
    """Parameters of ``grasp_evaluator`` beside those of the planner."""

    streaming: bool = option(True, "Score every new list of candidates")
    kept_revisions: int = fixed(
        option(16, "Volumes remembered for candidates that come late", 1, 64)
    )


@dataclass(frozen=True, kw_only=True)
class ReachConfig(ReachabilityConfig):
    """Parameters of ``reachability_filter``, all read-only after start."""

    streaming: bool = option(True, "Check every new list of scored grasps")
    robot: str = option("tiago_dual", "Robot's name or its YAML file")
    gripper: str = option("robotiq_2f85", "Gripper's name or its YAML file")
    arms: tuple[str, ...] = option(
        ("arm_left_torso", "arm_right_torso"), "Planning groups to try"
    )
    max_grasps: int = option(512, "Grasps checked of one list", 1, 4096)
    keep_unreachable: bool = option(False, "Publish them too, marked and last")
    ik: IkConfig = part(IkConfig, "Inverse kinematics")


@dataclass(frozen=True, kw_only=True)
class ExecuteConfig(ExecutorConfig, SupportConfig):
    """Parameters of ``grasp_executor``, all read-only after start."""

    robot: str = option("tiago_dual", "Robot's name or its YAML file")
    controllers: tuple[str, ...] = option(
        ("torso_controller", "arm_left_controller", "arm_right_controller"),
        "Trajectory controllers; each moves the joints that begin like its name",
    )
    open_fully: bool = option(
        True, "Approach with open jaws, as the network learned; else with Grasp.width"
    )
    fresh_view: float = option(
        3.0, "Longest wait for a view newer than the last motion [s]", 0.0, 60.0
    )
    reach: ReachabilityConfig = part(ReachabilityConfig, "What a grasp needs")
    mover: MoverConfig = part(MoverConfig, "How the arm moves")


@dataclass(frozen=True, kw_only=True)
class ServerConfig(SelectionConfig):
    """Parameters of ``grasp_server``."""

    target_frame: str = option("base_footprint", "Frame of the answers")
    max_grasps: int = option(20, "Grasps answered", 1, 1000)
    max_candidates: int = option(256, "Candidates scored", 1, 10000)
    timeout: float = option(30.0, "Longest time for a request [s]", 0.1, 600.0)
    min_views: int = option(1, "Views fused before a detection", 1, 100)
    goal_policy: str = option(
        "reject", "A goal while another runs", choices=("reject", "queue", "preempt")
    )
    scene: str = option(
        "current",
        "View to use where the request says current",
        choices=("current", "fresh", "reset"),
    )
