# SPDX-License-Identifier: Apache-2.0
"""Clutter-removal rounds, their metrics and reports."""
