# SPDX-License-Identifier: Apache-2.0
"""Every exception that this package raises on purpose."""

import copyreg
from collections.abc import Iterable
from typing import Any


class NeuGraspError(Exception):
    """Base of all errors that a caller may want to catch."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Let an error come back from a worker process, whatever its arguments."""
        rebuild = copyreg.__newobj__  # type: ignore[attr-defined]  # stub lacks it
        return rebuild, (type(self), *self.args), vars(self)


class ConfigError(NeuGraspError, ValueError):
    """A configuration value is out of range or its key is unknown."""


class ShapeError(NeuGraspError, ValueError):
    """An array does not have the shape that was promised.

    Args:
        name: What the array holds.
        expected: The expected shape, in words, such as ``(N, 3)``.
        got: The shape that came.
    """

    def __init__(self, name: str, expected: str, got: tuple[int, ...]) -> None:
        super().__init__(f"{name}: expected shape {expected}, got {got}")
        self.expected = expected
        self.got = got


class DepthImageError(NeuGraspError, ValueError):
    """A depth image cannot be used: encoding, size or content."""


class EmptySceneError(NeuGraspError):
    """Nothing was observed inside the workspace."""


class RevisionError(NeuGraspError):
    """Candidates belong to another volume revision than the one at hand."""


class CheckpointError(NeuGraspError):
    """A weights file is missing, damaged, or made for another network.

    Args:
        path: The file.
        reason: What is wrong with it, and what was expected.
    """

    def __init__(self, path: object, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = path


class UnknownNameError(NeuGraspError, KeyError):
    """A name is not in a registry.

    Args:
        kind: What was looked up, such as ``gripper``.
        name: The name that came.
        known: The names there are.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.known = tuple(sorted(known))
        known_words = ", ".join(self.known) or "none"
        self.message = f"unknown {kind} {name!r}; known: {known_words}"
        super().__init__(self.message)

    def __str__(self) -> str:
        """Return the sentence itself; KeyError would show its repr."""
        return self.message


class UnknownAffordanceError(UnknownNameError):
    """An affordance query names a class that the network does not know."""


class RobotModelError(NeuGraspError):
    """A frame, joint or group is not in the robot description.

    Args:
        kind: What was looked up, such as ``frame``.
        name: The name that came.
        known: The names there are.
    """

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        self.known = tuple(known)
        super().__init__(
            f"the robot description has no {kind} {name!r}; "
            f"it has: {', '.join(self.known)}"
        )


class MotionError(NeuGraspError):
    """No motion was found, or one was asked for that must not be made."""


class CanceledError(NeuGraspError):
    """What was running was stopped on request."""


class UnreachableError(MotionError):
    """A pose that no arm can bring its hand to.

    Args:
        code: A ``REACH_*`` number.
        reason: What is in the way, in words.
    """

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code


class SimulationError(NeuGraspError):
    """The physics engine refused a body or a body did not settle."""


class ShardError(NeuGraspError):
    """A data shard is damaged or was written by another version."""


class SceneFileError(NeuGraspError):
    """A saved scene is missing, damaged, or cannot be written.

    Args:
        path: The file.
        reason: What is wrong with it, and what was expected.
    """

    def __init__(self, path: object, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = path


class ObjectFileError(NeuGraspError):
    """An object's file is missing, broken, or not what its ending says.

    Args:
        path: The file or part.
        reason: What is wrong with it, and what was expected.
    """

    def __init__(self, path: object, reason: str) -> None:
        super().__init__(f"{path}: {reason}")
        self.path = path
