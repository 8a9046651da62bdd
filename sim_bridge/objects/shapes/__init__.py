# SPDX-License-Identifier: Apache-2.0
"""Parametric shapes, built of convex parts in object frames with z up."""
