# SPDX-License-Identifier: Apache-2.0
"""Labelled grasps from simulated scenes."""
