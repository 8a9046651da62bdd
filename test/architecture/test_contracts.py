# SPDX-License-Identifier: Apache-2.0
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("neugrasp_ros", "sim_bridge")
LONGEST_FILE = 400  # lines
HEAVY = ("torch", "open3d", "pybullet", "pinocchio", "ompl", "rclpy", "scipy")

FORBIDDEN = (
    ("neugrasp_ros/grasp/types.py", "rclpy"),
    ("neugrasp_ros/geometry/mesh.py", "torch"),
    ("neugrasp_ros/robot/ik.py", "pybullet"),
    ("neugrasp_ros/scene/field.py", "neugrasp_ros.grasp.types"),
    ("sim_bridge/world.py", "neugrasp_ros.pipeline"),
    ("neugrasp_ros/pipeline/planner.py", "sim_bridge"),
)


def sources() -> list[Path]:
    folders = (*PACKAGES, "test", "tools", "msg_defs")
    files = [p for name in folders for p in sorted((ROOT / name).rglob("*.py"))]
    return [ROOT / "setup.py", *files]


def check_imports(folder: Path) -> str:
    """Return what import-linter says of a copy of the packages, blanks squeezed."""
    linter = Path(sys.executable).parent / "lint-imports"
    done = subprocess.run(
        [linter, "--no-cache"],
        cwd=folder,
        env={"PYTHONPATH": str(folder), "PATH": "", "COLUMNS": "200"},
        capture_output=True,
        text=True,
    )
    return " ".join(done.stdout.split()) if done.returncode else ""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("packages")
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name in PACKAGES:
        ignore = shutil.ignore_patterns("__pycache__", "assets", "weights")
        shutil.copytree(ROOT / name, folder / name, ignore=ignore)
    return folder


@pytest.mark.slow
def test_import_contracts_are_kept(copy):
    assert check_imports(copy) == ""


@pytest.mark.slow
def test_forbidden_imports_are_found(copy):
    for file, module in FORBIDDEN:
        with (copy / file).open("a") as source:
            source.write(f"\nimport {module}\n")
    told = check_imports(copy)
    for file, module in FORBIDDEN:
        importer = file.removesuffix(".py").replace("/", ".")
        assert f"{importer} -> {module} (l." in told


@pytest.mark.slow
def test_a_new_top_level_module_must_be_placed(copy):
    (copy / "neugrasp_ros" / "unplaced.py").touch()
    assert "unplaced" in check_imports(copy)


def test_importing_the_package_pulls_nothing_heavy():
    program = f"import sys, neugrasp_ros; print(set({HEAVY}) & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize("path", sources(), ids=lambda p: str(p.relative_to(ROOT)))
def test_source_file_is_short_and_names_its_licence(path):
    lines = path.read_text().splitlines()
    assert len(lines) <= LONGEST_FILE
    assert not lines or lines[0] == "# SPDX-License-Identifier: Apache-2.0"
