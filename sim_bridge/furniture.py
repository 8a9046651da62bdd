# SPDX-License-Identifier: Apache-2.0
"""What stands in front of the robot: table, shelf, cupboard, and boxes to fill.

Lengths in [m], positions in the robot's base frame: x ahead, z up from the floor.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from neugrasp_ros.errors import UnknownNameError

FloatArray = NDArray[np.float64]

FRONT = 0.33  # of all furniture
WOOD = (0.76, 0.60, 0.42)
WHITE = (0.88, 0.88, 0.86)
BLUE = (0.25, 0.45, 0.70)


class Block(NamedTuple):
    """An upright solid box.

    Attributes:
        name: What it is a part of.
        center: Shape (3,).
        size: Full edge lengths, shape (3,).
        color: Red, green, blue, 0..1.
    """

    name: str
    center: FloatArray
    size: FloatArray
    color: tuple[float, float, float] = WOOD


@dataclass(frozen=True, slots=True)
class Furniture:
    """A place for objects.

    Attributes:
        name: Name.
        support_height: Height of the face that objects lie on.
        support: The block whose top that face is.
        later: Blocks that would be in the way of objects falling in.
        kind: Scene kind unless another is asked for.
    """

    name: str
    support_height: float
    support: Block
    others: tuple[Block, ...]
    later: tuple[Block, ...] = ()
    kind: str = "pile"


@dataclass(frozen=True, slots=True)
class Bin:
    """An open box on a stand.

    Attributes:
        center: Of its opening, at the rim, shape (3,).
        edge: Outer edge of the square footprint.
        depth: From the rim to the inner floor.
        thickness: Of its walls.
    """

    center: tuple[float, float, float]
    edge: float = 0.30
    depth: float = 0.20
    thickness: float = 0.01

    def blocks(self) -> tuple[Block, ...]:
        """Return stand and walls."""
        x, y, rim = self.center
        floor, e, t = rim - self.depth, self.edge, self.thickness
        parts = [_block("bin", (x, y, floor / 2), (e, e, floor), WHITE)]
        for sign in (-1.0, 1.0):
            shift, middle = sign * (e - t) / 2, floor + self.depth / 2
            parts.append(
                _block("bin", (x + shift, y, middle), (t, e, self.depth), BLUE)
            )
            parts.append(
                _block("bin", (x, y + shift, middle), (e, t, self.depth), BLUE)
            )
        return tuple(parts)

    def solid(self) -> Block:
        """Return the one box that a hand stays out of."""
        x, y, rim = self.center
        return _block("bin", (x, y, rim / 2), (self.edge, self.edge, rim), BLUE)


BINS = {"left": Bin((0.34, 0.62, 0.58)), "right": Bin((0.34, -0.62, 0.58))}
DROP_ABOVE = 0.20  # of a bin's rim, where the TCP lets go


def _block(
    name: str,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    color: tuple[float, float, float] = WOOD,
) -> Block:
    return Block(name, np.array(center), np.array(size), color)


def _board(
    name: str, depth: float, width: float, top: float, color: tuple[float, ...] = WOOD
) -> Block:
    r, g, b = color
    thickness = 0.03
    center = (FRONT + depth / 2, 0.0, top - thickness / 2)
    return _block(name, center, (depth, width, thickness), (r, g, b))


def _table() -> Furniture:
    depth, width, height = 0.60, 0.80, 0.70
    legs = tuple(
        _block("table", (x, y, 0.335), (0.05, 0.05, 0.67))
        for x in (FRONT + 0.03, FRONT + depth - 0.03)
        for y in (-width / 2 + 0.03, width / 2 - 0.03)
    )
    return Furniture("table", height, _board("table", depth, width, height), legs)


def _shelf() -> Furniture:
    depth, width, height, room = 0.42, 0.80, 0.80, 0.50
    top = height + room
    sides = tuple(
        _block("shelf", (FRONT + depth / 2, y, top / 2), (depth, 0.02, top), WHITE)
        for y in (-width / 2, width / 2)
    )
    back = _block(
        "shelf", (FRONT + depth + 0.01, 0.0, top / 2), (0.02, width, top), WHITE
    )
    upper = _board("shelf", depth, width, top + 0.03, WHITE)
    low = _board("shelf", depth, width, height - 0.45, WHITE)
    board = _board("shelf", depth, width, height, WHITE)
    return Furniture("shelf", height, board, (*sides, low), (back, upper), "packed")


def _cupboard() -> Furniture:
    depth, width, height = 0.45, 0.80, 0.90
    body = _block(
        "cupboard",
        (FRONT + depth / 2, 0.0, (height - 0.03) / 2),
        (depth - 0.02, width - 0.02, height - 0.03),
        WHITE,
    )
    return Furniture("cupboard", height, _board("top", depth, width, height), (body,))


FURNITURE = {item.name: item for item in (_table(), _shelf(), _cupboard())}


def read_kind(kind: str) -> tuple[Furniture, str]:
    """Return furniture and scene kind of ``shelf``, ``packed`` or ``shelf:pile``.

    Raises:
        UnknownNameError: If there is no such furniture.
    """
    first, colon, second = kind.partition(":")
    if first in FURNITURE:
        return FURNITURE[first], second or FURNITURE[first].kind
    if colon:
        raise UnknownNameError("furniture", first, FURNITURE)
    return FURNITURE["table"], kind
