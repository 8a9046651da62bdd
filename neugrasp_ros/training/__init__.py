# SPDX-License-Identifier: Apache-2.0
"""From labelled scenes to weights."""
