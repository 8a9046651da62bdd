# SPDX-License-Identifier: Apache-2.0
"""Grasps with all that a ``GraspArray`` says of them, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.geometry.transform import apply
from neugrasp_ros.grasp.types import GraspSet

FloatArray = NDArray[np.float64]

STAGE_CANDIDATES, STAGE_SCORED, STAGE_REACHABLE = range(3)


@dataclass(frozen=True, slots=True, kw_only=True)
class GraspInfo:
    """What holds for all grasps of a list.

    Attributes:
        frame_id: Frame of every pose.
        stamp: Time of the newest depth image used, in [ns].
        axes: Convention of the published poses, see ``nodes.frames``.
        stage: 0 candidates, 1 scored, 2 checked against the robot.
        gripper: Name of the gripper model.
        tcp_frame: TF frame to bring onto a pose.
        query: Affordance asked for; empty = none.
        labels: Names of the affordance classes.
        joint_names: Order of the joint positions.
        revision: Revision of the volume that the grasps came from.
    """

    frame_id: str
    stamp: int = 0
    axes: int = 0
    stage: int = STAGE_CANDIDATES
    gripper: str = ""
    tcp_frame: str = ""
    query: str = ""
    labels: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = ()
    revision: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """What the robot makes of G grasps.

    Attributes:
        codes: ``Grasp.REACH_*`` of each, shape (G,).
        arms: Planning group that reaches it; empty = none.
        manipulability: 0..1, NaN = not checked, shape (G,).
        joints: Joint positions in [rad] or [m], shape (J,) or (0,).
    """

    codes: NDArray[np.uint8]
    arms: tuple[str, ...]
    manipulability: FloatArray
    joints: tuple[FloatArray, ...]

    @classmethod
    def unknown(cls, count: int) -> "Reach":
        """Return what is known before any check."""
        return cls(
            codes=np.zeros(count, dtype=np.uint8),
            arms=("",) * count,
            manipulability=np.full(count, np.nan),
            joints=(np.zeros(0),) * count,
        )

    @classmethod
    def joined(cls, parts: Sequence["Reach"]) -> "Reach":
        """Return one after another what the robot makes of several lists."""
        return cls(
            codes=np.concatenate([part.codes for part in parts]),
            arms=tuple(arm for part in parts for arm in part.arms),
            manipulability=np.concatenate([part.manipulability for part in parts]),
            joints=tuple(joints for part in parts for joints in part.joints),
        )

    def take(self, rows: NDArray[np.int64]) -> "Reach":
        """Return the rows at the given indices."""
        return Reach(
            codes=self.codes[rows],
            arms=tuple(self.arms[i] for i in rows),
            manipulability=self.manipulability[rows],
            joints=tuple(self.joints[i] for i in rows),
        )


def _no_contacts() -> FloatArray:
    return np.zeros((0, 2, 3))


@dataclass(frozen=True, slots=True, eq=False)
class GraspList:
    """G grasps, best first, in the frame of their ``info``.

    Attributes:
        info: What holds for all of them.
        grasps: Poses ``T_frame_gripper``, widths, scores, ids.
        affordance: Score of the queried affordance, shape (G,); NaN = no query.
        contacts: Expected contact points in ``frame_id`` in [m], shape (G, 2, 3); NaN
            where none are known.
        reach: What the robot makes of them.
    """

    info: GraspInfo
    grasps: GraspSet
    affordance: FloatArray = field(default_factory=lambda: np.zeros(0))
    contacts: FloatArray = field(default_factory=_no_contacts)
    reach: Reach | None = None

    def __post_init__(self) -> None:
        """Fill what is not given."""
        if len(self.affordance) != len(self.grasps):
            missing = np.full(len(self.grasps), np.nan)
            object.__setattr__(self, "affordance", missing)
        if len(self.contacts) != len(self.grasps):
            nowhere = np.full((len(self.grasps), 2, 3), np.nan)
            object.__setattr__(self, "contacts", nowhere)

    def __len__(self) -> int:
        """Return the number of grasps."""
        return len(self.grasps)

    def take(self, indices: NDArray[np.int64] | NDArray[np.bool_]) -> "GraspList":
        """Return the grasps at ``indices`` (integers in order, or a mask)."""
        mask = indices.dtype == bool
        rows = np.flatnonzero(indices) if mask else indices.astype(np.int64)
        return replace(
            self,
            grasps=self.grasps.take(rows),
            affordance=self.affordance[rows],
            contacts=self.contacts[rows],
            reach=self.reach.take(rows) if self.reach else None,
        )

    def moved(self, T_new_old: FloatArray, frame_id: str) -> "GraspList":
        """Return the same grasps seen from another frame."""
        return replace(
            self,
            info=replace(self.info, frame_id=frame_id),
            grasps=replace(self.grasps, poses=T_new_old @ self.grasps.poses),
            contacts=apply(T_new_old, self.contacts),
        )


def joined(parts: list[GraspList]) -> GraspList:
    """Return lists of the same scene as one list."""
    if len(parts) == 1:
        return parts[0]
    sets = [part.grasps for part in parts]
    grasps = replace(
        sets[0],
        poses=np.concatenate([s.poses for s in sets]),
        widths=np.concatenate([s.widths for s in sets]),
        quality=np.concatenate([s.quality for s in sets]),
        affordances=np.concatenate([s.affordances for s in sets]),
        object_ids=np.concatenate([s.object_ids for s in sets]),
        ids=tuple(i for s in sets for i in s.ids),
    )
    reach = None
    if parts[0].reach is not None:
        reach = Reach.joined([part.reach for part in parts if part.reach is not None])
    return replace(
        parts[0],
        grasps=grasps,
        affordance=np.concatenate([part.affordance for part in parts]),
        contacts=np.concatenate([part.contacts for part in parts]),
        reach=reach,
    )
