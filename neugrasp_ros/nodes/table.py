# SPDX-License-Identifier: Apache-2.0
"""The nodes of the suite: one table for ``neugrasp up`` and for ``ros2 launch``."""

from collections.abc import Sequence
from dataclasses import dataclass

DEPTH_TOPICS = {
    "depth/image": "head_front_camera/depth_registered/image_raw",
    "depth/camera_info": "head_front_camera/depth_registered/camera_info",
}
TF_TOPICS = {"/tf": "tf", "/tf_static": "tf_static"}  # per robot, in a namespace
PARAMETERS = "tiago_2f85"  # name of the parameter file in config/


@dataclass(frozen=True, slots=True)
class NodeSpec:
    """A node as a process.

    Attributes:
        name: Node name, and name of its executable.
        module: Python module with its ``main``.
        needs_clock: Compares stamps with the time now, so it must follow ``/clock``
            in simulation. The others only pass stamps on and are spared the messages.
        reads_depth: Gets the camera's topics remapped.
    """

    name: str
    module: str
    needs_clock: bool = False
    reads_depth: bool = False


PROCESSING = (
    NodeSpec("tsdf_fusion", "neugrasp_ros.nodes.tsdf_fusion", True, True),
    NodeSpec("scene_renderer", "neugrasp_ros.nodes.scene_renderer"),
    NodeSpec("grasp_evaluator", "neugrasp_ros.nodes.grasp_evaluator"),
    NodeSpec("reachability_filter", "neugrasp_ros.nodes.reachability_filter"),
    NodeSpec("grasp_server", "neugrasp_ros.nodes.grasp_server", True, True),
)
COMPOSED = NodeSpec("grasp_suite", "neugrasp_ros.nodes.composed", reads_depth=True)
SIMULATOR = NodeSpec("sim_bridge", "sim_bridge.bridge_node")
ROBOT_SIMULATOR = NodeSpec("sim_bridge", "sim_bridge.robot_bridge_node")
EXECUTOR = NodeSpec("grasp_executor", "neugrasp_ros.nodes.grasp_executor", True)


def suite(
    *, sim: bool, separate: bool, whole_robot: bool = False
) -> tuple[NodeSpec, ...]:
    """Return the processes to start: one for all nodes, or one for each.

    Args:
        sim: With the simulated cell.
        separate: One process for each processing node.
        whole_robot: With the node that moves the arms; the simulated cell is a whole
            robot then, not a gripper alone.
    """
    processing = PROCESSING if separate else (COMPOSED,)
    simulator = ROBOT_SIMULATOR if whole_robot else SIMULATOR
    before = (simulator,) if sim else ()
    return (*before, *processing, *((EXECUTOR,) if whole_robot else ()))


def clock_users(spec: NodeSpec) -> tuple[str, ...]:
    """Return the nodes of a process that follow ``/clock`` in simulation."""
    nodes = PROCESSING if spec is COMPOSED else (spec,)
    return tuple(node.name for node in nodes if node.needs_clock)


def remappings(spec: NodeSpec, namespace: str = "") -> dict[str, str]:
    """Return the topics that a process gets under other names."""
    remaps = dict(DEPTH_TOPICS) if spec.reads_depth else {}
    return remaps | (TF_TOPICS if namespace else {})


def ros_arguments(
    spec: NodeSpec,
    *,
    sim: bool = False,
    namespace: str = "",
    parameter_files: Sequence[str] = (),
    remaps: Sequence[str] = (),
    parameters: Sequence[str] = (),
) -> list[str]:
    """Return the command line of a process after its program.

    Args:
        spec: The process.
        sim: Follow ``/clock``.
        namespace: Namespace of all nodes, such as ``/tiago_1``.
        parameter_files: YAML files, later ones win.
        remaps: More remappings, ``from:=to``; they win over the table's.
        parameters: Single parameters, ``node:name:=value`` or ``name:=value``.
    """
    arguments = ["--ros-args"]
    if namespace:
        arguments += ["-r", f"__ns:=/{namespace.strip('/')}"]
    for rule in remaps:
        arguments += ["-r", rule]
    for source, target in remappings(spec, namespace).items():
        arguments += ["-r", f"{source}:={target}"]
    for path in parameter_files:
        arguments += ["--params-file", path]
    if sim:
        for node in clock_users(spec):
            arguments += ["-p", f"{node}:use_sim_time:=true"]
    for parameter in parameters:
        arguments += ["-p", parameter]
    return arguments
