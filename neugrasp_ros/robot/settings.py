# SPDX-License-Identifier: Apache-2.0
"""What a reachability check asks for, as checked options."""

from dataclasses import dataclass

from neugrasp_ros.config import Checked, option


@dataclass(frozen=True, kw_only=True)
class IkConfig(Checked):
    """Inverse kinematics of one arm."""

    tol_position: float = option(0.001, "Largest position error [m]", 1e-6, 0.01)
    tol_rotation: float = option(0.005, "Largest rotation error [rad]", 1e-6, 0.1)
    max_iterations: int = option(40, "Steps from one seed", 1, 10000)
    restarts: int = option(
        12, "Starts of a search in all, the nearest stored postures first", 1, 1024
    )
    random_starts: int = option(
        0, "Random starts behind the stored postures, where those are fewer", 0, 1024
    )
    reach_map: bool = option(
        True, "Rule out at once where no sampled posture brought the wrist"
    )
    joint_margin: float = option(
        0.02, "Distance kept from every joint limit [rad or m]", 0.0, 1.0
    )
    slide_weight: float = option(
        0.3, "Mobility of sliding joints against turning ones", 0.001, 1.0
    )


@dataclass(frozen=True, kw_only=True)
class ReachabilityConfig(Checked):
    """A grasp as motion: to the pre-grasp, straight ahead, and up."""

    pregrasp_distance: float = option(0.10, "Way back from the grasp [m]", 0.0, 0.5)
    lift_distance: float = option(0.10, "Way up with the object [m]", 0.0, 0.5)
    path_spacing: float = option(
        0.02, "Spacing of the poses solved and checked on the way [m]", 0.002, 0.1
    )
    max_joint_change: float = option(
        0.5, "Largest change of a joint between two such poses [rad]", 0.01, 2.0
    )
    check_self_collision: bool = option(True, "Refuse self-collision")
    check_scene_collision: bool = option(True, "Refuse collision with the scene")
    padding: float = option(0.003, "Distance kept by all links [m]", 0.0, 0.05)
    jaw_padding: float = option(
        0.001, "Distance kept by fingers and palm from the scene [m]", 0.0, 0.02
    )
    held_radius: float = option(
        0.12, "Scene around the TCP that travels with the hand in a lift [m]", 0.0, 0.5
    )
    first_starts: int = option(
        1, "Starts of inverse kinematics tried on every grasp, arm and side", 1, 1024
    )
    most_starts: int = option(
        2, "Starts in all where those find no solution for a grasp", 1, 1024
    )
    retries: int = option(
        5, "Other solutions tried when one fails in collision or on its path", 0, 1024
    )
    travel_weight: float = option(
        0.03, "Manipulability given up to arrive a second earlier [1/s]", 0.0, 1.0
    )
    min_manipulability: float = option(0.0, "Smallest manipulability", 0.0, 1.0)
