# SPDX-License-Identifier: Apache-2.0
"""The stage nodes on their own, beside a composed suite in namespace ``one``."""

from nodes.bench import PATIENT
from nodes.camera_node import CameraNode, ClientNode
from nodes.standin import SurfacePlanner, make_side_checker
from rclpy.parameter import Parameter

from neugrasp_ros.nodes.composed import Suite
from neugrasp_ros.nodes.executor import PatientExecutor
from neugrasp_ros.nodes.grasp_evaluator import GraspEvaluatorNode
from neugrasp_ros.nodes.grasp_server import GraspServerNode
from neugrasp_ros.nodes.reachability_filter import ReachabilityFilterNode
from neugrasp_ros.nodes.runtime import SpinThread
from neugrasp_ros.nodes.scene_renderer import SceneRendererNode
from neugrasp_ros.nodes.shared_planner import SharedPlanner
from neugrasp_ros.nodes.tsdf_fusion import TsdfFusionNode

CAMERA_TOPICS = ["--ros-args"]
for topic in ("depth/image", "depth/camera_info"):
    CAMERA_TOPICS += ["-r", f"{topic}:=/{topic}"]


def make_planner(config) -> SharedPlanner:
    return SharedPlanner(SurfacePlanner(("pour", "lift")), config.gripper)


class SeparateBench:
    """A camera, a user of each suite, and what is started of the suites."""

    def __init__(self) -> None:
        self.executor = PatientExecutor(20)
        self.camera, self.user = CameraNode(), ClientNode()
        self.other = ClientNode(namespace="one")
        self.nodes = [self.camera, self.user, self.other]
        for node in self.nodes:
            self.executor.add_node(node)
        self.spinning = SpinThread(self.executor)
        self.camera.send_tf()
        self.suite = None

    def add(self, node):
        self.nodes.append(node)
        self.executor.add_node(node)
        return node

    def start_separate(self, *, evaluator: bool = True) -> None:
        late = Parameter("max_depth_age", value=PATIENT)
        self.add(GraspServerNode())
        self.add(TsdfFusionNode(parameter_overrides=[late]))
        self.add(SceneRendererNode(make_planner))
        self.add(ReachabilityFilterNode(make_side_checker))
        if evaluator:
            self.add(GraspEvaluatorNode(make_planner))

    def start_composed(self) -> None:
        self.suite = Suite(
            self.executor, make_planner, make_side_checker,
            namespace="one", cli_args=CAMERA_TOPICS,
        )  # fmt: skip
        late = Parameter("max_depth_age", value=PATIENT)
        self.suite.nodes[0].set_parameters([late])
        self.suite.load()

    def stop(self) -> None:
        self.spinning.stop()
        if self.suite:
            self.suite.close()
        for node in self.nodes:
            node.destroy_node()

    def call(self, kind, name, /, **fields):
        return self.user.call(kind, name, **fields)
