# SPDX-License-Identifier: Apache-2.0
"""``ros2 launch neugrasp_ros grasp.launch.py``: the same nodes as ``neugrasp up``."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from neugrasp_ros.nodes.table import (
    PARAMETERS,
    SIMULATOR,
    clock_users,
    remappings,
    suite,
)
from neugrasp_ros.resources import parameter_file

ARGUMENTS = {
    "sim": ("false", "start the simulated cell, too"),
    "separate": ("false", "one process per node"),
    "use_sim_time": ("false", "follow /clock; always so with sim:=true"),
    "namespace": ("", "namespace of all nodes"),
    "params_file": ("", "more parameters, a path or a name in config/"),
    "respawn": ("false", "start a node again that ended"),
    "log_level": ("info", "debug, info, warn, error"),
    "rviz": ("false", "start RViz with our view"),
}


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and, once they are known, the nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes that the arguments ask for."""

    def value(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    def is_set(name: str) -> bool:
        return value(name).lower() in ("true", "1")

    namespace = value("namespace")
    more = [value("params_file")] if value("params_file") else []
    files = [parameter_file(name) for name in (PARAMETERS, *more)]
    sim_time = is_set("sim") or is_set("use_sim_time")
    started = []
    for spec in suite(sim=is_set("sim"), separate=is_set("separate")):
        arguments = ["--ros-args", "--log-level", value("log_level")]
        if sim_time and spec is not SIMULATOR:
            for name in clock_users(spec):
                arguments += ["-p", f"{name}:use_sim_time:=true"]
        started.append(
            Node(
                package="neugrasp_ros",
                executable=spec.name,
                namespace=namespace,
                parameters=files,
                remappings=list(remappings(spec, namespace).items()),
                respawn=is_set("respawn"),
                arguments=arguments,
                output="screen",
            )
        )
    if is_set("rviz"):
        view = parameter_file("rviz/grasp.rviz")
        started.append(
            Node(package="rviz2", executable="rviz2", arguments=["-d", view])
        )
    return started
