# SPDX-License-Identifier: Apache-2.0
"""Simulated objects, scenes and grippers, and the bridge that looks like a robot."""
