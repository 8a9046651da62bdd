# SPDX-License-Identifier: Apache-2.0
"""The occupancy network and the renderer of its surface."""
