# SPDX-License-Identifier: Apache-2.0
"""Policies that other processes can import, for the tests of the benchmark."""

import numpy as np

from neugrasp_ros.benchmark.protocol import Plan
from neugrasp_ros.grasp.types import GraspSet


def answer_nothing(look, rng):
    return Plan(GraspSet(np.zeros((0, 4, 4)), np.zeros(0)))


def setup_nothing():
    return answer_nothing, None
