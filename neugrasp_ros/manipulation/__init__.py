# SPDX-License-Identifier: Apache-2.0
"""A grasp carried out: the robot's ways through its scene, step by step."""
