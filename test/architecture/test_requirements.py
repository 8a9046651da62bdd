# SPDX-License-Identifier: Apache-2.0
import importlib.metadata
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parents[2]
FILES = ("requirements.txt", "requirements-dev.txt", "constraints.txt")
PIN = re.compile(r"[A-Za-z0-9._-]+(\[\w+\])?==[\w.!]+")
PYTHONS = ("3.11.0", "3.12.0")
NETWORK = "NEUGRASP_NETWORK_TESTS"


def lines(file: str) -> list[tuple[str, str]]:
    """Return each requirement of a file with the comment beside it."""
    parts = (line.partition("#") for line in (ROOT / file).read_text().splitlines())
    return [(pin.strip(), why.strip()) for pin, _, why in parts if pin.strip()]


def pins() -> list[Requirement]:
    return [Requirement(pin) for file in FILES for pin, _ in lines(file)]


def test_every_requirement_is_pinned_exactly():
    loose = [pin for file in FILES for pin, _ in lines(file) if not PIN.fullmatch(pin)]
    assert loose == []


def test_no_package_is_pinned_twice():
    names = [re.sub(r"[-_.]+", "-", pin.name).lower() for pin in pins()]
    assert sorted(set(names)) == sorted(names)


def test_every_direct_requirement_has_a_reason():
    lonely = [
        pin
        for pin, why in lines("requirements.txt")
        if not why and pin.split("==")[0] not in ("setuptools", "wheel")
    ]
    assert lonely == []


@pytest.mark.parametrize("pin", pins(), ids=str)
def test_installed_version_is_the_pinned_one_and_runs_on_both_pythons(pin):
    package = importlib.metadata.distribution(pin.name)
    assert pin.specifier.contains(package.version)
    accepted = SpecifierSet(package.metadata.get("Requires-Python") or "")
    assert all(accepted.contains(version) for version in PYTHONS)


def test_only_one_open3d_is_installed():
    importlib.metadata.distribution("open3d-cpu")
    with pytest.raises(importlib.metadata.PackageNotFoundError):
        importlib.metadata.distribution("open3d")


def test_pybullet_returns_images_as_arrays():
    import pybullet

    assert pybullet.isNumpyEnabled() == 1


@pytest.mark.slow
@pytest.mark.skipif(NETWORK not in os.environ, reason=f"asks an index; set {NETWORK}=1")
@pytest.mark.parametrize("version", ["3.11", "3.12"])
def test_every_pin_has_a_file_for_the_python(tmp_path, version):
    """pybullet's is its source on 3.12: `make setup` builds it there."""
    command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet"]
    command += ["--ignore-installed", "--no-deps", "--target", str(tmp_path)]
    command += ["--python-version", version]
    for file in FILES:
        command += ["-r", str(ROOT / file)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
