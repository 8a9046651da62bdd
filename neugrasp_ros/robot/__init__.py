# SPDX-License-Identifier: Apache-2.0
"""Which grasps an arm can reach."""
