# SPDX-License-Identifier: Apache-2.0
"""The ``neugrasp`` command line."""
