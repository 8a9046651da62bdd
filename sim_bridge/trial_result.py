# SPDX-License-Identifier: Apache-2.0
"""What a grasp attempt gave, and the names of its failures."""

from dataclasses import dataclass

PREGRASP_COLLISION = "pregrasp_collision"
TABLE_CONTACT = "table_contact"
DISTURBED = "disturbed"
EMPTY = "empty"
SLIPPED = "slipped"
SNAGGED = "snagged"

FAILURES = (PREGRASP_COLLISION, TABLE_CONTACT, DISTURBED, EMPTY, SLIPPED, SNAGGED)


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialResult:
    """Outcome of one grasp attempt.

    Attributes:
        reason: Empty on success, else one of ``FAILURES``.
        width: Opening of the jaws at the end in [m].
        stop_depth: How far before the grasp pose the approach ended, in [m].
        touched: Whether the gripper had any contact before the jaws closed.
        object_body: Body held at the end, -1 if none.
        shake_held: Whether the object stayed through a shake; None if not tried.
    """

    reason: str
    width: float
    stop_depth: float = 0.0
    touched: bool = False
    object_body: int = -1
    shake_held: bool | None = None

    @property
    def success(self) -> bool:
        """Whether the attempt counts as a success."""
        return not self.reason
