# SPDX-License-Identifier: Apache-2.0
"""PEP 517 backend: builds the ROS interface packages of this folder into one wheel.

In comes an environment with the ROS wheels' generators (pip makes it from
pyproject.toml), out goes ``neugrasp_msgs-*.whl`` with the Python modules at its root
and the shared libraries in ``<environment>/lib``, where rosidl looks for them.
"""

import base64
import hashlib
import os
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from pathlib import Path
from xml.etree import ElementTree

HERE = Path(__file__).resolve().parent
NAME = "neugrasp_msgs"
# A fallback package builds nothing where the environment has the published one.
PACKAGES = (HERE / "fallback/tf2_msgs", HERE / "fallback/control_msgs", HERE)
PYTHON = f"cp{sys.version_info.major}{sys.version_info.minor}"
PLATFORM = sysconfig.get_platform().replace("-", "_").replace(".", "_")
TAG = f"{PYTHON}-{PYTHON}-{PLATFORM}"
WHEEL = (
    f"Wheel-Version: 1.0\nGenerator: {NAME} backend\n"
    f"Root-Is-Purelib: false\nTag: {TAG}\n"
)
SITE = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"


def prepare_metadata_for_build_wheel(
    metadata_directory: str, config_settings: dict[str, str] | None = None
) -> str:
    """Write the metadata, so that pip need not compile to see it (PEP 517)."""
    version = package_version()
    info = Path(metadata_directory) / f"{NAME}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(metadata(version))
    (info / "WHEEL").write_text(WHEEL)
    return info.name


def build_wheel(
    wheel_directory: str,
    config_settings: dict[str, str] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build the wheel into ``wheel_directory`` and return its file name (PEP 517)."""
    version = package_version()
    wheel = Path(wheel_directory) / f"{NAME}-{version}-{TAG}.whl"
    with tempfile.TemporaryDirectory(prefix="neugrasp_msgs_") as folder:
        prefix = Path(folder) / "install"
        for package in PACKAGES:
            compile_package(package, Path(folder) / "build" / package.name, prefix)
        write_wheel(wheel, prefix, f"{NAME}-{version}.dist-info", metadata(version))
    return wheel.name


def build_sdist(
    sdist_directory: str, config_settings: dict[str, str] | None = None
) -> str:
    """Refuse: the interfaces are installed from this folder or from a wheel."""
    raise RuntimeError("neugrasp_msgs has no source distribution; build the wheel")


def package_version() -> str:
    """Return the version, which stands in package.xml alone."""
    return ElementTree.parse(HERE / "package.xml").findtext("version", "")


def compile_package(source: Path, build: Path, prefix: Path) -> None:
    """Configure, compile and install one interface package into ``prefix``."""
    environment = build_environment(prefix)
    options = {
        "Python3_EXECUTABLE": sys.executable,
        "PYTHON_EXECUTABLE": sys.executable,
        "CMAKE_INSTALL_PREFIX": prefix,
        "CMAKE_BUILD_TYPE": "Release",
        "BUILD_TESTING": "OFF",
        "PYTHON_INSTALL_DIR": SITE,
    }
    configure = ["cmake", "-G", "Ninja", "-S", source, "-B", build]
    configure += [f"-D{key}={value}" for key, value in options.items()]
    for command in (configure, ["cmake", "--build", build, "--target", "install"]):
        print(f"[{source.name}]", *command, flush=True)
        subprocess.run(command, check=True, env=environment)


def build_environment(prefix: Path) -> dict[str, str]:
    """Return the variables with which CMake and the generators find the ROS wheels."""
    import ament_package

    site = Path(ament_package.__file__).resolve().parents[1]
    ros = site.parents[2]
    libraries = [ros / "lib", *sorted(site.glob("ros_*.libs"))]
    packages = f"{prefix}{os.pathsep}{ros}"
    return {
        **os.environ,
        "AMENT_PREFIX_PATH": packages,
        "CMAKE_PREFIX_PATH": packages,
        "LD_LIBRARY_PATH": os.pathsep.join(map(str, libraries)),
        # The ROS wheels restart Python to set the library path; it is set already.
        "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",
    }


def metadata(version: str) -> str:
    """Return the METADATA file; what the messages contain is needed to import them."""
    return (
        f"Metadata-Version: 2.1\nName: neugrasp-msgs\nVersion: {version}\n"
        "Summary: Messages, services and actions of neugrasp_ros\n"
        "License: Apache-2.0\nRequires-Python: >=3.11\n"
        "Requires-Dist: ros-jazzy-rclpy\nRequires-Dist: ros-jazzy-common-interfaces\n"
    )


def write_wheel(wheel: Path, prefix: Path, info: str, metadata_text: str) -> None:
    """Pack an install prefix: modules to the root, libraries and share/ to the data."""
    data = info.replace(".dist-info", ".data/data")
    files = {}
    for path in sorted(p for p in prefix.rglob("*") if p.is_file()):
        inside = path.relative_to(prefix)
        if path.suffix in {".c", ".pyc"}:  # pip compiles the bytecode itself
            continue
        if inside.is_relative_to(SITE):
            files[str(inside.relative_to(SITE))] = path.read_bytes()
        elif inside.parts[0] == "share" or inside.suffix == ".so":
            files[f"{data}/{inside}"] = path.read_bytes()
    files[f"{info}/METADATA"] = metadata_text.encode()
    files[f"{info}/WHEEL"] = WHEEL.encode()
    record = [
        f"{name},sha256={digest(content)},{len(content)}"
        for name, content in files.items()
    ]
    record.append(f"{info}/RECORD,,\n")
    files[f"{info}/RECORD"] = "\n".join(record).encode()
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)


def digest(content: bytes) -> str:
    """Return the SHA-256 of ``content`` as RECORD wants it."""
    code = base64.urlsafe_b64encode(hashlib.sha256(content).digest())
    return code.rstrip(b"=").decode()
