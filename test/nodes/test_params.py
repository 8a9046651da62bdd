# SPDX-License-Identifier: Apache-2.0
from dataclasses import dataclass, field

import pytest

from neugrasp_ros.config import Checked, option
from neugrasp_ros.errors import ConfigError

pytest.importorskip("rclpy")

from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402

from neugrasp_ros.nodes.params import declare_config, fixed  # noqa: E402

pytestmark = pytest.mark.ros


@dataclass(frozen=True, kw_only=True)
class Inner(Checked):
    frame: str = option("base", "A frame")
    origin: tuple[float, float, float] = option((0.0, 0.0, 1.5), "Corner [m]")


@dataclass(frozen=True, kw_only=True)
class Sample(Checked):
    rate: float = option(10.0, "Rate [Hz]", 0.1, 60.0)
    count: int = fixed(option(3, "How many", 1, 9))
    mode: str = option("latest", "View mode", choices=("latest", "fuse"))
    inner: Inner = field(default_factory=Inner, metadata={"doc": "Inner"})


def make_node(spinner, **overrides):
    values = [Parameter(k.replace("__", "."), value=v) for k, v in overrides.items()]
    return spinner.add(
        Node("sample", parameter_overrides=values, start_parameter_services=False)
    )


def test_defaults_and_descriptions_come_from_the_dataclass(spinner):
    node = make_node(spinner)
    assert declare_config(node, Sample).current == Sample()
    described = node.describe_parameter("rate")
    assert described.description == "Rate [Hz]"
    assert described.floating_point_range[0].to_value == 60.0
    assert node.describe_parameter("count").read_only
    assert "fuse" in node.describe_parameter("mode").additional_constraints
    assert list(node.get_parameter("inner.origin").value) == [0.0, 0.0, 1.5]


def test_integers_are_widened_to_doubles(spinner):
    node = make_node(spinner, rate=2, inner__origin=[1, 2, 3])
    config = declare_config(node, Sample).current
    assert config.rate == 2.0 and isinstance(config.rate, float)
    assert config.inner.origin == (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        ({"rate": 1000.0}, r"rate must be in \[0.1, 60.0\], got 1000.0"),
        ({"rate": "fast"}, "rate must be float, got 'fast'"),
        ({"count": 0}, "count must be in"),
        ({"count": 2.5}, "count must be int"),
        ({"mode": "oldest"}, "mode must be one of latest, fuse"),
        ({"inner__origin": [1.0, 2.0]}, "inner.origin must be 3 of float"),
    ],
)
def test_an_absurd_override_is_refused(spinner, overrides, sentence):
    node = make_node(spinner, **overrides)
    with pytest.raises(ConfigError, match=sentence):
        declare_config(node, Sample)


def test_a_live_change_is_validated_then_applied(spinner):
    node = make_node(spinner)
    live = declare_config(node, Sample)
    assert node.set_parameters([Parameter("rate", value=5)])[0].successful
    assert live.current.rate == 5.0
    assert node.set_parameters([Parameter("inner.frame", value="map")])[0].successful
    assert live.current.inner.frame == "map"
    refused = node.set_parameters([Parameter("mode", value="oldest")])[0]
    assert not refused.successful and "latest" in refused.reason
    assert not node.set_parameters([Parameter("count", value=4)])[0].successful
    assert live.current.mode == "latest" and live.current.count == 3
