# SPDX-License-Identifier: Apache-2.0
import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.msg import DetectionReport  # noqa: E402

from neugrasp_ros.errors import (  # noqa: E402
    CheckpointError,
    ConfigError,
    EmptySceneError,
    RevisionError,
    UnknownAffordanceError,
)
from neugrasp_ros.nodes.outcomes import (  # noqa: E402
    Code,
    DetectionError,
    as_detection_error,
    from_message,
    to_message,
)


def test_every_code_of_the_report_is_known():
    constants = {
        name: getattr(DetectionReport, name)
        for name in dir(DetectionReport)
        if name.isupper() and isinstance(getattr(DetectionReport, name), int)
    }
    assert {code.name: int(code) for code in Code} == constants


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (
            UnknownAffordanceError("affordance", "fly", ("cut",)),
            Code.UNKNOWN_AFFORDANCE,
        ),
        (EmptySceneError("nothing"), Code.EMPTY_WORKSPACE),
        (RevisionError("revision 3, expected 4"), Code.INVALID_REQUEST),
        (ConfigError("width must be positive"), Code.INVALID_REQUEST),
        (CheckpointError("w.safetensors", "damaged"), Code.INTERNAL),
        (DetectionError(Code.TF_ERROR, "a <- b"), Code.TF_ERROR),
    ],
)
def test_errors_become_codes_and_survive_a_service(error, code):
    assert as_detection_error(error).code == code
    back = from_message(to_message(error))
    assert (back.code, back.sentence) == (code, str(error))


def test_a_message_without_a_code_is_internal():
    assert from_message("what: is this").code == Code.INTERNAL
