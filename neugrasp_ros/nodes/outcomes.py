# SPDX-License-Identifier: Apache-2.0
"""Why a detection ended: codes of ``DetectionReport``, errors, and sentences."""

from enum import IntEnum

from neugrasp_msgs.msg import DetectionReport

from neugrasp_ros.errors import (
    ConfigError,
    EmptySceneError,
    NeuGraspError,
    RevisionError,
    RobotModelError,
    SceneFileError,
    ShapeError,
    UnknownAffordanceError,
    UnknownNameError,
)


class Code(IntEnum):
    """The result codes of ``DetectionReport``."""

    NONE = DetectionReport.NONE
    CANCELED = DetectionReport.CANCELED
    TIMEOUT = DetectionReport.TIMEOUT
    NOT_ACTIVE = DetectionReport.NOT_ACTIVE
    INVALID_REQUEST = DetectionReport.INVALID_REQUEST
    UNKNOWN_AFFORDANCE = DetectionReport.UNKNOWN_AFFORDANCE
    NO_DEPTH = DetectionReport.NO_DEPTH
    STALE_DEPTH = DetectionReport.STALE_DEPTH
    NO_CAMERA_INFO = DetectionReport.NO_CAMERA_INFO
    TF_ERROR = DetectionReport.TF_ERROR
    EMPTY_WORKSPACE = DetectionReport.EMPTY_WORKSPACE
    NO_CANDIDATES = DetectionReport.NO_CANDIDATES
    NONE_ABOVE_QUALITY = DetectionReport.NONE_ABOVE_QUALITY
    NONE_WITH_AFFORDANCE = DetectionReport.NONE_WITH_AFFORDANCE
    NONE_REACHABLE = DetectionReport.NONE_REACHABLE
    INTERNAL = DetectionReport.INTERNAL


class DetectionError(NeuGraspError):
    """A detection, or one stage of it, ended without a grasp.

    Args:
        code: Which of the reasons it is.
        sentence: The reason for people, with numbers and what to do.
    """

    def __init__(self, code: Code, sentence: str) -> None:
        super().__init__(sentence)
        self.code = code
        self.sentence = sentence


CODES = (
    (UnknownAffordanceError, Code.UNKNOWN_AFFORDANCE),
    (EmptySceneError, Code.EMPTY_WORKSPACE),
    (RevisionError, Code.INVALID_REQUEST),
    (RobotModelError, Code.INVALID_REQUEST),
    (UnknownNameError, Code.INVALID_REQUEST),
    (ConfigError, Code.INVALID_REQUEST),
    (SceneFileError, Code.INVALID_REQUEST),
    (ShapeError, Code.INVALID_REQUEST),
)


def as_detection_error(error: NeuGraspError) -> DetectionError:
    """Return the reason that an error of the library stands for."""
    if isinstance(error, DetectionError):
        return error
    for kind, code in CODES:
        if isinstance(error, kind):
            return DetectionError(code, str(error))
    return DetectionError(Code.INTERNAL, str(error))


def to_message(error: NeuGraspError) -> str:
    """Return an error as the ``message`` of a stage service: ``CODE: sentence``."""
    reason = as_detection_error(error)
    return f"{reason.code.name}: {reason.sentence}"


def from_message(message: str) -> DetectionError:
    """Return the error that a stage service reported in its ``message``."""
    name, separator, sentence = message.partition(": ")
    if separator and name in Code.__members__:
        return DetectionError(Code[name], sentence)
    return DetectionError(Code.INTERNAL, message)
