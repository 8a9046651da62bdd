# SPDX-License-Identifier: Apache-2.0
"""Finger joint and tip advance of a gripper against the distance of its pads.

A linkage gripper swings its pads on cranks. With H the half gap of open jaws, a the
advance of the tips, and h0 the half gap at which the cranks stand upright,

    r = ((H - h0)^2 + a^2) / 2a,   h(theta) = h0 + r cos(theta_0 + theta)

where theta is 0 for open jaws, as on the 2F-85 of a TIAGo (0 open, 0.8 rad closed). A
parallel slide (a = 0) has the way of one finger in [m] for a joint.
"""

import math

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.gripper import Gripper

FloatArray = NDArray[np.float64]

UPRIGHT_SHARE = 0.13  # h0 over H


def tip_advance_at(gripper: Gripper, openings: FloatArray | float) -> FloatArray:
    """Return how far the pad tips are ahead of the open ones, in [m].

    With h the half gap, z(h) = sqrt(r^2 - (h - h0)^2) - (r - a): 0 at the open half gap
    and a at h0, for the 2F-85 within 0.3 mm of its linkage. A parallel slide gives 0.

    Args:
        gripper: The gripper.
        openings: Distance of the inner pad faces in [m], any shape.
    """
    openings = np.asarray(openings, dtype=np.float64)
    advance = gripper.tip_advance
    if advance <= 0.0:
        return np.zeros_like(openings)
    half_open = gripper.max_opening / 2
    upright = UPRIGHT_SHARE * half_open
    crank = ((half_open - upright) ** 2 + advance**2) / (2 * advance)
    lateral = np.clip(openings / 2, 0.0, half_open) - upright
    return np.asarray(np.sqrt(crank**2 - lateral**2) - (crank - advance))


def opening_at(gripper: Gripper, joint: float) -> float:
    """Return the distance of the pads in [m] at a joint value in [rad] or [m]."""
    if gripper.tip_advance <= 0.0:
        half = gripper.max_opening / 2 - joint
    else:
        upright, radius, start = _crank(gripper)
        half = upright + radius * math.cos(start + joint)
    return min(max(2 * half, 0.0), gripper.max_opening)


def joint_at(gripper: Gripper, opening: float) -> float:
    """Return the joint value in [rad] or [m] for a distance of the pads in [m]."""
    half = min(max(opening, 0.0), gripper.max_opening) / 2
    if gripper.tip_advance <= 0.0:
        return gripper.max_opening / 2 - half
    upright, radius, start = _crank(gripper)
    return math.acos(min(max((half - upright) / radius, -1.0), 1.0)) - start


def _crank(gripper: Gripper) -> tuple[float, float, float]:
    """Return upright half gap and crank length in [m], and the open angle in [rad]."""
    half_open = gripper.max_opening / 2
    upright = UPRIGHT_SHARE * half_open
    reach = half_open - upright
    radius = (reach**2 + gripper.tip_advance**2) / (2 * gripper.tip_advance)
    return upright, radius, math.acos(reach / radius)
