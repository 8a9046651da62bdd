# SPDX-License-Identifier: Apache-2.0
import importlib
import re
import time
from pathlib import Path

import pytest
from msg_defs.snapshot import API, MSG_DEFS, api, definitions
from rosidl_adapter import parser

FALLBACK = sorted(
    path
    for kind in ("msg", "srv", "action")
    for path in (MSG_DEFS / "fallback").glob(f"*/{kind}/*.{kind}")
)


def package_of(path: Path) -> str:
    folder = path.parent.parent
    return "neugrasp_msgs" if folder == MSG_DEFS else folder.name


def identity(path: Path) -> str:
    return f"{package_of(path)}/{path.name}"


def test_the_interface_is_the_one_in_the_snapshot():
    hint = "a wanted change? run test/msg_defs/snapshot.py and add a CHANGELOG line"
    assert api() == API.read_text(), hint


@pytest.mark.parametrize("path", definitions() + FALLBACK, ids=identity)
def test_definition_parses(path):
    parse = getattr(parser, f"parse_{parser_kind(path)}_file")
    parse(package_of(path), str(path))


def parser_kind(path: Path) -> str:
    return {"msg": "message", "srv": "service", "action": "action"}[path.parent.name]


@pytest.mark.parametrize("path", definitions() + FALLBACK, ids=identity)
def test_definition_is_compiled_as_it_stands(path):
    """A difference means that the installed wheel is older than the definition."""
    module = importlib.import_module(f"{package_of(path)}.{path.parent.name}")
    compiled = getattr(module, path.stem)
    if path.parent.name == "msg":
        specification = parser.parse_message_file(package_of(path), str(path))
        expected = {str(field.name) for field in specification.fields}
        assert set(compiled.get_fields_and_field_types()) == expected
    else:
        parts = {
            "srv": ("Request", "Response"),
            "action": ("Goal", "Result", "Feedback"),
        }
        texts = re.split("^---$", path.read_text(), flags=re.MULTILINE)
        for part, text in zip(parts[path.parent.name], texts, strict=True):
            specification = parser.parse_message_string("x", "Part", text)
            expected = {str(field.name) for field in specification.fields}
            fields = set(getattr(compiled, part).get_fields_and_field_types())
            assert fields == expected


def test_an_empty_request_asks_for_the_parameters():
    from neugrasp_msgs.srv import DetectGrasps

    request = DetectGrasps.Request()
    assert request.min_quality == request.min_affordance == -1.0
    assert request.reachability == DetectGrasps.Request.REACH_LAST
    assert request.max_grasps == 0


def test_service_and_action_take_the_same_request():
    from neugrasp_msgs.action import DetectGrasps as Action
    from neugrasp_msgs.srv import DetectGrasps as Service

    of_service = Service.Request.get_fields_and_field_types()
    assert Action.Goal.get_fields_and_field_types() == of_service


@pytest.mark.ros
@pytest.mark.parametrize(
    ("package", "name"),
    [("neugrasp_msgs", "GraspArray"), ("tf2_msgs", "TFMessage")],
)
def test_message_travels_over_dds(package, name):
    import rclpy

    message_type = getattr(importlib.import_module(f"{package}.msg"), name)
    context = rclpy.Context()
    rclpy.init(context=context, args=[])
    node = rclpy.create_node("traveller", context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(node)
    received = []
    node.create_subscription(message_type, "travel", received.append, 1)
    publisher = node.create_publisher(message_type, "travel", 1)
    deadline = time.monotonic() + 20
    while not received and time.monotonic() < deadline:
        publisher.publish(message_type())
        executor.spin_once(timeout_sec=0.1)
    node.destroy_node()
    executor.shutdown()
    rclpy.shutdown(context=context)
    assert received[0] == message_type()
