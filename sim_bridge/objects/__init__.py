# SPDX-License-Identifier: Apache-2.0
"""Object sets: what lies in a scene, as convex parts and closed visual meshes."""
