# SPDX-License-Identifier: Apache-2.0
"""What a benchmark leaves behind: plain values that go to JSON and back."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from neugrasp_ros.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class AttemptRecord:
    """One grasp attempt.

    Attributes:
        round_index: Number of its round.
        number: Its number within the round.
        reason: Why it failed; empty on success.
        quality: What the policy promised; NaN if it promises nothing.
        T_task_gripper: The upper three rows of the pose, row by row (12 numbers).
        opening: Opening of the jaws on approach in [m].
        width: Opening at the end in [m].
        stop_depth: How far before the grasp the approach ended in [m].
        object_name: What was cleared; empty on failure.
        n_candidates: Grasps that the policy looked at.
        n_grasps: Grasps that it returned.
        timings: Seconds per stage.
        target: The object whose origin was nearest to the TCP, before the attempt.
    """

    round_index: int
    number: int
    reason: str
    quality: float
    T_task_gripper: tuple[float, ...]
    opening: float
    width: float
    stop_depth: float
    object_name: str
    n_candidates: int
    n_grasps: int
    timings: Mapping[str, float] = field(default_factory=dict)
    target: str = ""

    @property
    def success(self) -> bool:
        """Whether the attempt cleared an object."""
        return not self.reason


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundRecord:
    """One round.

    Attributes:
        index: Its number.
        n_objects: Objects on the table at its start.
        n_uncounted: Objects that do not count because the camera saw nothing of them.
        ended: ``cleared``, ``failures``, ``no_grasp`` or ``empty_view``.
        attempts: Its attempts, in order.
        scene: The recipe of its start.
        iou: Of the reconstruction from the first view; None without one.
    """

    index: int
    n_objects: int
    n_uncounted: int
    ended: str
    attempts: tuple[AttemptRecord, ...]
    scene: Mapping[str, Any]
    iou: float | None = None

    @property
    def n_successes(self) -> int:
        """How many attempts cleared an object."""
        return sum(attempt.success for attempt in self.attempts)

    @property
    def n_counted(self) -> int:
        """How many objects count for the declutter rate."""
        return self.n_objects - self.n_uncounted

    def as_record(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)


def round_from_record(record: Mapping[str, Any]) -> RoundRecord:
    """Read a round from the values that ``RoundRecord.as_record`` wrote.

    Raises:
        ConfigError: If values are missing or unknown.
    """
    try:
        attempts = tuple(
            AttemptRecord(**{**a, "T_task_gripper": tuple(a["T_task_gripper"])})
            for a in record["attempts"]
        )
        return RoundRecord(**{**record, "attempts": attempts})
    except (KeyError, TypeError) as error:
        raise ConfigError(f"not a round record: {error}") from error
