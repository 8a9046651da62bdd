# SPDX-License-Identifier: Apache-2.0
import time
from types import SimpleNamespace

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_msgs.srv import GetTsdf  # noqa: E402

from neugrasp_ros.nodes import remote_stages  # noqa: E402
from neugrasp_ros.nodes.outcomes import Code, DetectionError  # noqa: E402
from neugrasp_ros.nodes.remote_stages import RemoteStages  # noqa: E402
from neugrasp_ros.nodes.requests import SCENES  # noqa: E402

pytestmark = pytest.mark.ros


def test_a_wait_whose_calls_are_answered_at_once_can_be_stopped(monkeypatch):
    asked = []

    def call(*_):
        asked.append(time.monotonic())
        return GetTsdf.Response(success=False, message="no image yet")

    monkeypatch.setattr(remote_stages, "call", call)
    stages = object.__new__(RemoteStages)
    stages._tsdf = None
    wanted = SimpleNamespace(scene=SCENES["current"], min_views=1)
    deadline = time.monotonic() + 20.0
    with pytest.raises(DetectionError, match="canceled while it waited") as stopped:
        stages.scene(wanted, 1, deadline, lambda: len(asked) >= 3)
    assert stopped.value.code is Code.CANCELED
    assert len(asked) == 3
