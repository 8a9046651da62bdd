# SPDX-License-Identifier: Apache-2.0
"""Grasp candidates, their local views, and their scores."""
