# SPDX-License-Identifier: Apache-2.0
"""All processing nodes in one process, with one network between them."""

import importlib
import threading
import time
import traceback
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.executors import Executor
from rclpy.logging import get_logger
from rclpy.node import Node

from neugrasp_ros.errors import NeuGraspError
from neugrasp_ros.nodes.grasp_evaluator import GraspEvaluatorNode
from neugrasp_ros.nodes.grasp_server import GraspServerNode
from neugrasp_ros.nodes.local_stages import LocalStages
from neugrasp_ros.nodes.planners import MakePlanner, OnePlanner, load_planner
from neugrasp_ros.nodes.reach_stage import MakeChecker, load_checker
from neugrasp_ros.nodes.reachability_filter import ReachabilityFilterNode
from neugrasp_ros.nodes.runtime import START_ERROR, run, spare_what_is_loaded
from neugrasp_ros.nodes.scene_renderer import SceneRendererNode
from neugrasp_ros.nodes.transforms import Transforms
from neugrasp_ros.nodes.tsdf_fusion import TsdfFusionNode

NAME = "neugrasp"
THREADS = 10

NodeType = TypeVar("NodeType", bound=Node)


class Suite:
    """The processing nodes of one process.

    Fusion and server answer at once; the others join them when weights and robot are
    loaded, and until then a request is told which node is still loading.

    Args:
        executor: What the nodes spin in.
        make_planner: Loads the planner, once for all nodes.
        make_checker: Loads the robot.
        node_options: For every node, such as ``namespace``.
    """

    def __init__(
        self,
        executor: Executor,
        make_planner: MakePlanner = load_planner,
        make_checker: MakeChecker = load_checker,
        **node_options: Any,
    ) -> None:
        self._executor = executor
        self._make_planner = OnePlanner(make_planner)
        self._make_checker = make_checker
        self._options = node_options
        self.nodes: list[Node] = []
        fusion = TsdfFusionNode(lambda: self.stages.serves(), **node_options)
        self._transforms = Transforms(fusion.buffer)
        self.stages = LocalStages(self._transforms)
        self.stages.fusion = self._add(fusion).fusion
        self._add(GraspServerNode(self.stages, **node_options))

    def _add(self, node: NodeType) -> NodeType:
        self.nodes.append(node)
        self._executor.add_node(node)
        return node

    def load(self) -> None:
        """Load weights and robot and add the nodes that need them.

        Raises:
            NeuGraspError: If one of them cannot be used.
        """
        options = self._options
        renderer = SceneRendererNode(self._make_planner, **options)
        self.stages.renderer = self._add(renderer).stage
        evaluator = GraspEvaluatorNode(self._make_planner, **options)
        self.stages.evaluator = self._add(evaluator).stage
        reach = ReachabilityFilterNode(
            self._make_checker,
            self._transforms,
            evaluator.stage.let_requests_go_first,
            **options,
        )
        self.stages.reach = self._add(reach).stage

    def close(self) -> None:
        """End all nodes."""
        for node in reversed(self.nodes):
            node.destroy_node()


def reason(error: Exception) -> str:
    """Return why the suite cannot start; of a bug with the traceback."""
    if isinstance(error, NeuGraspError):
        return str(error)
    return f"{error!r}\n{''.join(traceback.format_exception(error))}"


def main(args: list[str] | None = None) -> int:
    """Run all processing nodes until shutdown."""
    # SciPy looks for torch in every call; a callback must not find it half imported
    importlib.import_module("torch")
    failed: list[Exception] = []

    def start(executor: Executor) -> Callable[[], None]:
        suite = Suite(executor)

        def load() -> None:
            begin = time.monotonic()
            get_logger(NAME).info("loading weights and robot; requests must wait")
            try:
                suite.load()
            except Exception as error:  # noqa: BLE001 (requests would wait for ever)
                if not executor.context.ok():  # ended meanwhile: that is no failure
                    return
                get_logger(NAME).fatal(f"cannot start: {reason(error)}")
                failed.append(error)
                executor.context.try_shutdown()
                return
            spare_what_is_loaded()
            seconds = time.monotonic() - begin
            get_logger(NAME).info(f"all nodes are ready after {seconds:.1f} s")

        threading.Thread(target=load, name="load", daemon=True).start()
        return suite.close

    code = run(NAME, start, args, threads=THREADS)
    return START_ERROR if failed else code
