# SPDX-License-Identifier: Apache-2.0
import argparse
import importlib
import importlib.util

import pytest

from neugrasp_ros.cli import main as cli
from neugrasp_ros.cli.main import COMMANDS, USAGE, build_parser, main
from neugrasp_ros.errors import ConfigError


def installed() -> list[str]:
    return [n for n in COMMANDS if importlib.util.find_spec(f"neugrasp_ros.cli.{n}")]


@pytest.mark.parametrize("name", installed())
def test_every_command_explains_itself(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    assert f"neugrasp {name}" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments", [[], ["fly"], ["detect", "--timeout", "soon"], ["up", "--wings"]]
)
def test_wrong_usage_ends_with_64(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == USAGE
    assert "usage: neugrasp" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("outcome", "code"), [(0, 0), (2, 2), (ConfigError("no such file: x"), 1)]
)
def test_the_exit_code_is_the_commands_and_errors_are_one_line(
    outcome, code, monkeypatch, capsys
):
    def run(_):
        if isinstance(outcome, Exception):
            raise outcome
        return outcome

    parser = argparse.ArgumentParser()
    parser.set_defaults(run=run)
    monkeypatch.setattr(cli, "build_parser", lambda: parser)
    assert main([]) == code
    error = capsys.readouterr().err
    assert error == ("neugrasp: no such file: x\n" if code == 1 else "")


def test_no_command_imports_ros_or_torch_before_it_runs():
    import subprocess
    import sys

    code = (
        "import sys; from neugrasp_ros.cli.main import build_parser; build_parser(); "
        "heavy = {'rclpy', 'torch', 'pybullet', 'open3d'}; "
        "print(sorted(heavy & set(sys.modules)))"
    )
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert out.strip() == "[]"


def test_the_parser_knows_all_that_is_there():
    text = build_parser().format_help()
    assert all(name in text for name in installed())
