# SPDX-License-Identifier: Apache-2.0
import itertools
import time

import pytest

from neugrasp_ros.training import loop


@pytest.fixture
def eager_checkpoints(monkeypatch):
    """Every look at the clock is a minute later: each step is kept."""
    minutes = itertools.count(time.monotonic(), 60.0)
    monkeypatch.setattr(loop.time, "monotonic", lambda: next(minutes))
