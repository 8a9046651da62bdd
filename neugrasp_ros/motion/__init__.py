# SPDX-License-Identifier: Apache-2.0
"""A reachable grasp as a time-parameterised path."""
