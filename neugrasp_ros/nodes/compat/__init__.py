# SPDX-License-Identifier: Apache-2.0
"""Pieces of ROS that PyPI lacks; the real package is taken where there is one."""
