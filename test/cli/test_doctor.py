# SPDX-License-Identifier: Apache-2.0
import argparse
from types import SimpleNamespace

import pytest

from neugrasp_ros.cli import doctor
from neugrasp_ros.cli.doctor import Finding, run


def test_what_is_wrong_is_shown_with_its_remedy(monkeypatch, capsys):
    looks = (lambda: Finding(True, "sky"), lambda: Finding(False, "rain", "umbrella"))
    monkeypatch.setattr(doctor, "LOOKS", looks)
    assert run(argparse.Namespace()) == 1
    said = capsys.readouterr().out
    assert "ok    sky" in said and "WRONG rain\n      umbrella" in said


def test_a_look_that_lacks_a_package_is_a_finding_and_the_others_follow(
    monkeypatch, capsys
):
    def needs_torch():
        raise ModuleNotFoundError("No module named 'torch'", name="torch")

    monkeypatch.setattr(doctor, "LOOKS", (needs_torch, lambda: Finding(True, "sky")))
    assert run(argparse.Namespace()) == 1
    said = capsys.readouterr().out
    assert "WRONG No module named 'torch'\n      make setup" in said
    assert "ok    sky" in said


def test_all_fine_ends_with_zero(monkeypatch):
    monkeypatch.setattr(doctor, "LOOKS", (lambda: Finding(True, "sky"),))
    assert run(argparse.Namespace()) == 0


@pytest.mark.parametrize(("megabytes", "good"), [(1, False), (64, True)])
def test_too_little_shared_memory_is_noticed(monkeypatch, megabytes, good):
    status = SimpleNamespace(f_bavail=megabytes, f_frsize=1 << 20)
    monkeypatch.setattr(doctor.os, "statvfs", lambda _: status)
    monkeypatch.setattr(doctor, "SHARED_MEMORY", SimpleNamespace(is_dir=lambda: True))
    finding = doctor.look_at_shared_memory()
    assert finding.good is good and f"{megabytes} MB" in finding.seen


def test_apt_and_pip_side_by_side_are_noticed(monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/jazzy")
    spec = SimpleNamespace(origin="/venv/rclpy/__init__.py")
    monkeypatch.setattr(doctor.importlib.util, "find_spec", lambda _: spec)
    assert not doctor.look_at_ros().good
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/venv")
    assert doctor.look_at_ros().good


def test_missing_packages_are_named(monkeypatch):
    monkeypatch.setattr(doctor.importlib.util, "find_spec", lambda name: None)
    finding = doctor.look_at_packages()
    assert not finding.good and "pybullet" in finding.seen
