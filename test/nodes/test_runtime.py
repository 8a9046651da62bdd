# SPDX-License-Identifier: Apache-2.0
import gc
import os
import platform
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

pytest.importorskip("rclpy")

from neugrasp_ros.benchmark.speed import resident_mb  # noqa: E402
from neugrasp_ros.nodes import runtime  # noqa: E402
from neugrasp_ros.nodes.runtime import (  # noqa: E402
    NO_TUNING,
    PROFILE_VARIABLES,
    give_back_memory,
    prepare,
    spare_what_is_loaded,
)

TALKER = Path(__file__).with_name("node_that_talks.py")
LARGEST_IMAGE = 640 * 480 * 4  # bytes of a depth image


@pytest.fixture(autouse=True)
def clean(monkeypatch):
    for name in (
        *PROFILE_VARIABLES,
        NO_TUNING,
        "AMENT_PREFIX_PATH",
        "RMW_IMPLEMENTATION",
    ):
        monkeypatch.delenv(name, raising=False)


def test_the_profile_is_ours_and_its_segment_holds_several_images():
    assert "Fast DDS profile" in prepare()
    path = Path(os.environ[PROFILE_VARIABLES[0]])
    sizes = [
        int(e.text) for e in ElementTree.parse(path).iter() if "segment_size" in e.tag
    ]
    assert len(sizes) == 1 and sizes[0] >= 3 * LARGEST_IMAGE


def test_what_the_user_has_set_is_left_alone(monkeypatch):
    monkeypatch.setenv(PROFILE_VARIABLES[1], "/mine.xml")
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/mine")
    done = prepare()
    assert "Fast DDS profile" not in done and PROFILE_VARIABLES[0] not in os.environ
    assert os.environ["AMENT_PREFIX_PATH"] == "/opt/mine"


def test_another_middleware_gets_no_fast_dds_profile(monkeypatch):
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    assert "Fast DDS profile" not in prepare()


def test_it_can_be_turned_off(monkeypatch):
    monkeypatch.setenv(NO_TUNING, "1")
    assert prepare() == ()
    monkeypatch.setenv(NO_TUNING, "0")
    assert prepare()


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc's allocator")
def test_free_memory_goes_back_to_the_system():
    prepare()
    held = [number * b"x" for number in range(1 << 20, (1 << 20) + 200)]
    last = held[-1]  # keeps the heap's end where it is
    before = resident_mb()
    held.clear()
    give_back_memory()
    assert resident_mb() < before - 150
    assert last


def test_ament_finds_the_environment():
    prepare()
    assert os.environ["AMENT_PREFIX_PATH"] == sys.prefix


def test_what_is_loaded_is_never_looked_at_by_the_garbage_collector_again():
    before = gc.get_freeze_count()
    spare_what_is_loaded()
    try:
        assert gc.get_freeze_count() > before and len(gc.get_objects()) < 1000
    finally:
        gc.unfreeze()


def test_library_logs_go_to_ros_once():
    import logging

    runtime.forward_library_logs("test_logs")
    runtime.forward_library_logs("test_logs")
    logger = logging.getLogger("neugrasp_ros")
    try:
        assert len(logger.handlers) == 1 and not logger.propagate
        for level in (logging.DEBUG, logging.INFO, logging.WARNING, logging.ERROR):
            logger.log(level, "a record of level %d", level)
    finally:
        for package in ("neugrasp_ros", "sim_bridge"):
            logging.getLogger(package).handlers = []
            logging.getLogger(package).propagate = True


@pytest.mark.ros
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_node_that_is_told_to_stop_ends_without_a_word(domain, number):
    process = subprocess.Popen(
        [sys.executable, TALKER], text=True, stdout=-1, stderr=subprocess.STDOUT
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "talking\n"
    process.send_signal(number)
    said, _ = process.communicate(timeout=30)
    assert (process.returncode, said) == (0, "")


@pytest.mark.ros
@pytest.mark.parametrize("words", [["-p", "nonsense"], ["-r", "no_arrow"]])
def test_a_command_line_that_ros_cannot_read_is_one_sentence(domain, words):
    ended = subprocess.run(
        [sys.executable, TALKER, "--ros-args", *words], capture_output=True, text=True
    )
    said = ended.stdout + ended.stderr
    assert ended.returncode == 1 and "cannot start: " in said, said
    assert " ".join(words) in said and "Traceback" not in said
