# SPDX-License-Identifier: Apache-2.0
"""A suite whose weights or robot cannot be loaded ends, whatever the reason."""

import time
from types import SimpleNamespace

import pytest

pytest.importorskip("neugrasp_msgs")

from neugrasp_ros.config import PlannerConfig  # noqa: E402
from neugrasp_ros.errors import ConfigError  # noqa: E402
from neugrasp_ros.nodes import composed  # noqa: E402
from neugrasp_ros.nodes.planners import load_planner  # noqa: E402
from neugrasp_ros.nodes.runtime import START_ERROR  # noqa: E402


class Context:
    """A context that says whether it was shut down."""

    def __init__(self) -> None:
        self.is_up = True

    def ok(self) -> bool:
        return self.is_up

    def try_shutdown(self) -> None:
        self.is_up = False


class Suite:
    """A suite that cannot be loaded for one reason."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def load(self) -> None:
        raise self.error

    def close(self) -> None:
        pass


@pytest.fixture
def ended(monkeypatch):
    """Return a function that runs the suite until it ends by itself."""

    def run(name, start, args, threads) -> int:
        context = Context()
        start(SimpleNamespace(context=context))
        deadline = time.monotonic() + 10.0
        while context.ok() and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not context.ok(), "the suite goes on, and loads for ever"
        return 0

    def code(error: Exception) -> int:
        monkeypatch.setattr(composed, "run", run)
        monkeypatch.setattr(composed, "Suite", lambda _: Suite(error))
        return composed.main([])

    return code


def test_a_bug_while_loading_ends_the_suite_with_its_traceback(ended, capfd):
    assert ended(ValueError("a bug")) == START_ERROR
    said = "".join(capfd.readouterr())
    assert "cannot start: ValueError('a bug')" in said and "Traceback" in said


def test_what_is_configured_wrongly_ends_the_suite_with_a_sentence(ended, capfd):
    assert ended(ConfigError("no such thing")) == START_ERROR
    said = "".join(capfd.readouterr())
    assert "cannot start: no such thing" in said and "Traceback" not in said


def test_a_device_that_is_not_here_is_a_configuration_error():
    with pytest.raises(ConfigError, match="device 'gpu' cannot be used; torch"):
        load_planner(PlannerConfig(device="gpu"))
