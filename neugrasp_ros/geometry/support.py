# SPDX-License-Identifier: Apache-2.0
"""What counts as the support that objects stand on."""

ABOVE_SUPPORT = 0.008  # [m]; what reaches less far above its support is the support
