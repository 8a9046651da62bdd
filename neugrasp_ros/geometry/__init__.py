# SPDX-License-Identifier: Apache-2.0
"""Rigid transforms, cameras, grippers, meshes and ray casting."""
