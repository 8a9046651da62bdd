# SPDX-License-Identifier: Apache-2.0
"""Qualities of service, by kind of topic."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions


def overrides() -> QoSOverridingOptions:
    """Let parameters ``qos_overrides.<topic>...`` change a topic's policies."""
    return QoSOverridingOptions.with_default_policies()


def sensor_input(depth: int = 5) -> QoSProfile:
    """Return best effort: takes what reliable and best-effort cameras send."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def sensor_output(depth: int = 5) -> QoSProfile:
    """Return reliable, so that every kind of subscriber can listen."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE)


def latched() -> QoSProfile:
    """Return reliable and transient local: a late joiner gets the last one."""
    return QoSProfile(
        depth=1,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    )


def newest() -> QoSProfile:
    """Return reliable, only the last one, nothing for late joiners."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
