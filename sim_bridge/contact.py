# SPDX-License-Identifier: Apache-2.0
"""How a body touches others, and where it does."""

from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True, slots=True)
class BodyDynamics:
    """Contact and damping values of a body; None leaves the engine's default.

    Attributes:
        friction: Lateral friction coefficient [-]; None takes the model's.
        spinning: Spinning friction coefficient [m].
        rolling: Rolling friction coefficient [m].
        linear_damping: Share of velocity lost per second [1/s].
    """

    friction: float | None = None
    spinning: float = 0.0
    rolling: float = 0.0
    linear_damping: float | None = None


class Contact(NamedTuple):
    """One contact point between two links; -1 is a body's base link.

    Attributes:
        body_a: First body.
        link_a: Its link.
        body_b: Second body.
        link_b: Its link.
        distance: Gap in [m]; negative when the shapes overlap.
        force: Normal force of the last step in [N].
    """

    body_a: int
    link_a: int
    body_b: int
    link_b: int
    distance: float
    force: float
