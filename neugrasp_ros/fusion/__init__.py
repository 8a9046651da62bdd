# SPDX-License-Identifier: Apache-2.0
"""Depth images in, truncated signed distances out."""
