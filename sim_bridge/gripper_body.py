# SPDX-License-Identifier: Apache-2.0
"""A gripper's measures as a description that the physics engine reads."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.gripper import Gripper
from neugrasp_ros.geometry.transform import translation
from sim_bridge.bodies import box_tag, collision_tag, inertial_tag

HAND_MASS = 0.81  # [kg], of the benchmark's hand
FINGER_MASS = 0.1  # [kg]
CARRIAGE_MASS = 0.1  # [kg], carries the fingers of a hand whose tips advance


def base_center_of_mass(gripper: Gripper) -> NDArray[np.float64]:
    """Return the palm box's centre in the gripper frame in [m], shape (3,)."""
    return np.asarray(gripper.boxes(0.0)[0][2])


def write_gripper_urdf(gripper: Gripper, path: Path) -> None:
    """Write a hand box and two sliding finger boxes; the base is the gripper frame.

    Joints ``left`` (+y) and ``right`` (-y) hold half the opening each. A gripper whose
    tips advance gets a joint ``advance`` along z between the hand and the fingers.
    """
    centers, half_extents = gripper.boxes(0.0)
    carrier = "hand" if gripper.tip_advance <= 0.0 else "carriage"
    parts = [_link("hand", HAND_MASS, centers[2], half_extents[2])]
    if carrier == "carriage":
        parts.append(
            f'<link name="carriage">{inertial_tag(centers[2], CARRIAGE_MASS)}</link>'
        )
        parts.append(
            _joint("advance", "hand", carrier, "0 0 1", gripper.tip_advance, 1e4)
        )
    for index, (name, axis) in enumerate((("left", "0 1 0"), ("right", "0 -1 0"))):
        parts.append(_link(name, FINGER_MASS, centers[index], half_extents[index]))
        parts.append(
            _joint(
                name, carrier, name, axis, gripper.max_opening / 2, gripper.max_force
            )
        )
    path.write_text(f'<robot name="gripper">{"".join(parts)}</robot>')


def _link(
    name: str,
    mass: float,
    center: NDArray[np.float64],
    half_extents: NDArray[np.float64],
) -> str:
    shape = collision_tag(translation(*center), box_tag(half_extents))
    return f'<link name="{name}">{inertial_tag(center, mass)}{shape}</link>'


def _joint(
    name: str, parent: str, child: str, axis: str, travel: float, effort: float
) -> str:
    return (
        f'<joint name="{name}" type="prismatic"><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/>'
        f'<limit lower="0" upper="{travel:.9g}" effort="{effort:.9g}" velocity="1"/>'
        "</joint>"
    )
