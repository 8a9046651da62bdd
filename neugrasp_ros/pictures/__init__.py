# SPDX-License-Identifier: Apache-2.0
"""Pictures of decisions and results, drawn with matplotlib; no ROS, no network."""
