# SPDX-License-Identifier: Apache-2.0
import collections
import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
Usage = collections.namedtuple("Usage", "total used free")


@pytest.fixture
def bootstrap(tmp_path, monkeypatch):
    """The set-up module, looking at an empty copy of the repository."""
    path = ROOT / "tools" / "bootstrap.py"
    specification = importlib.util.spec_from_file_location("bootstrap", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    for name in module.INPUTS:
        copy = tmp_path / name
        copy.parent.mkdir(exist_ok=True)
        copy.write_bytes((ROOT / name).read_bytes())
    (tmp_path / "msg_defs" / "msg").mkdir(parents=True)
    (tmp_path / "msg_defs" / "msg" / "Grasp.msg").write_text("float32 width\n")
    for name, value in {
        "ROOT": tmp_path,
        "VENV": tmp_path / ".venv",
        "PYTHON": tmp_path / ".venv" / "bin" / "python",
        "STAMP": tmp_path / ".venv" / "neugrasp.stamp",
        "INSTALLED_MESSAGES": tmp_path / ".venv" / "neugrasp_msgs.key",
        "LOG": tmp_path / ".venv" / "setup.log",
    }.items():
        monkeypatch.setattr(module, name, value)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("TORCH_INDEX", raising=False)
    return module


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """Put shell scripts of given names before everything else on PATH."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")

    def add(**scripts):
        for name, body in scripts.items():
            path = folder / name
            path.write_text(f"#!/bin/sh\n{body}\n")
            path.chmod(0o755)
        return folder

    return add


def make_ready(bootstrap) -> None:
    """Leave what a finished set-up leaves, as far as the stamp needs it."""
    bootstrap.PYTHON.parent.mkdir(parents=True)
    bootstrap.PYTHON.symlink_to(sys.executable)
    bootstrap.STAMP.write_text(bootstrap.stamp())


def fail(*_):
    raise AssertionError("nothing should be run")


# ---- one sentence for each thing that is missing


def test_a_complete_machine_passes(bootstrap):
    bootstrap.check_machine()


def test_old_glibc(bootstrap, programs):
    programs(getconf="echo glibc 2.31")
    told = bootstrap.check_platform()
    assert told.startswith("old C library: glibc 2.35 or newer is needed")
    assert told.endswith("found glibc 2.31")


def test_another_c_library(bootstrap, programs):
    programs(getconf="exit 1")
    assert "another C library" in bootstrap.check_platform()


def test_no_venv_module(bootstrap, programs, monkeypatch):
    python = programs(lame="exit 1") / "lame"
    monkeypatch.setattr(bootstrap, "base_python", lambda: str(python))
    told = bootstrap.check_venv_module()
    assert told.startswith("no venv module") and "-venv" in told


@pytest.mark.parametrize("compiler", ["/nowhere/g++", "false"])
def test_no_compiler(bootstrap, monkeypatch, compiler):
    monkeypatch.setenv("CXX", compiler)
    assert bootstrap.check_compiler().startswith(f"no compiler: {compiler}")


def test_no_python_headers(bootstrap, monkeypatch):
    monkeypatch.setattr(bootstrap.sysconfig, "get_path", lambda _: "/nowhere")
    assert bootstrap.check_compiler().startswith("no Python headers")


def test_too_little_disk(bootstrap, monkeypatch):
    usage = Usage(100e9, 98e9, 2e9)
    monkeypatch.setattr(bootstrap.shutil, "disk_usage", lambda _: usage)
    told = bootstrap.check_disk()
    assert told.startswith("too little disk: 6 GB are needed")
    assert told.endswith("2.0 free")


def test_all_problems_are_told_at_once_and_nothing_is_made(
    bootstrap, programs, monkeypatch, capsys
):
    programs(getconf="echo glibc 2.31")
    monkeypatch.setenv("CXX", "/nowhere/g++")
    assert bootstrap.main() == 1
    told = capsys.readouterr().err
    assert "old C library" in told and "no compiler" in told
    assert not bootstrap.VENV.exists()


def test_no_network(bootstrap, monkeypatch):
    monkeypatch.setattr(bootstrap, "PYTHON", Path(sys.executable))
    monkeypatch.setenv("PIP_CONFIG_FILE", os.devnull)
    monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    monkeypatch.setenv("PIP_RETRIES", "0")
    for name in ("PIP_FIND_LINKS", "PIP_EXTRA_INDEX_URL"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(bootstrap.SetupError, match="no network: pip finds no package"):
        bootstrap.torch_index()


# ---- which torch


def answer_with(bootstrap, monkeypatch, versions: str) -> None:
    text = f"torch\nAvailable versions: {versions}\n"
    monkeypatch.setattr(bootstrap, "run_quietly", lambda _: text)


def test_cpu_build_in_reach_needs_no_words(bootstrap, monkeypatch, capsys):
    answer_with(bootstrap, monkeypatch, "2.15.0, 2.13.0+cpu, 2.13.0")
    assert bootstrap.torch_index() == []
    assert capsys.readouterr().out == ""


def test_only_the_cuda_build_in_reach_is_told_with_its_size(
    bootstrap, monkeypatch, capsys
):
    answer_with(bootstrap, monkeypatch, "2.15.0, 2.13.0")
    monkeypatch.setenv("TORCH_INDEX", "https://index.example/cpu")
    options = bootstrap.torch_index()
    assert options == ["--extra-index-url", "https://index.example/cpu"]
    told = capsys.readouterr().out
    assert "about 3 GB" in told and "TORCH_INDEX=" in told


def test_cuda_build_needs_more_disk(bootstrap, monkeypatch):
    answer_with(bootstrap, monkeypatch, "2.13.0")
    usage = Usage(100e9, 90e9, 10e9)
    monkeypatch.setattr(bootstrap.shutil, "disk_usage", lambda _: usage)
    with pytest.raises(bootstrap.SetupError, match="16 GB are needed"):
        bootstrap.torch_index()


# ---- called again


def test_second_call_runs_nothing(bootstrap, monkeypatch):
    make_ready(bootstrap)
    for name in ("run", "run_quietly", "run_logged"):
        monkeypatch.setattr(bootstrap, name, fail)
    assert bootstrap.main() == 0


@pytest.mark.parametrize("changed", ["requirements.txt", "msg_defs/msg/Grasp.msg"])
def test_a_changed_input_installs_again(bootstrap, monkeypatch, changed):
    make_ready(bootstrap)
    with (bootstrap.ROOT / changed).open("a") as file:
        file.write("# changed\n")
    installed = []
    monkeypatch.setattr(bootstrap, "is_usable", lambda: True)
    monkeypatch.setattr(bootstrap, "install", lambda: installed.append(True))
    assert bootstrap.main() == 0
    assert installed == [True]
    assert bootstrap.STAMP.read_text() == bootstrap.stamp()


def test_a_failed_step_leaves_no_stamp(bootstrap, monkeypatch, capsys):
    def break_off():
        bootstrap.run_logged(
            [sys.executable, "-c", "print('why'); raise SystemExit(3)"]
        )

    monkeypatch.setattr(bootstrap, "make_venv", lambda: None)
    monkeypatch.setattr(bootstrap, "install", break_off)
    assert bootstrap.main() == 1
    assert "this step failed" in (told := capsys.readouterr().err) and "why" in told
    assert not bootstrap.STAMP.exists()


@pytest.mark.slow
def test_a_half_made_environment_is_made_anew(bootstrap):
    (bootstrap.VENV / "bin").mkdir(parents=True)
    (bootstrap.VENV / "leftover").touch()
    assert not bootstrap.is_usable()
    bootstrap.make_venv()
    assert bootstrap.is_usable()
    assert not (bootstrap.VENV / "leftover").exists()


def test_environment_of_another_python_or_folder_is_not_usable(bootstrap):
    (bootstrap.VENV / "bin").mkdir(parents=True)
    settings = bootstrap.VENV / "pyvenv.cfg"
    script = bootstrap.VENV / "bin" / "pip"
    script.write_text(f"#!{bootstrap.VENV}/bin/python\n")
    settings.write_text("version = 3.10.1\n")
    assert not bootstrap.is_usable()
    settings.write_text(f"version = {sys.version.split()[0]}\n")
    script.write_text("#!/another/place/.venv/bin/python\n")
    assert not bootstrap.is_usable()


def test_messages_are_installed_again_only_when_they_changed(bootstrap, monkeypatch):
    wheel = bootstrap.ROOT / "neugrasp_msgs.whl"
    monkeypatch.setattr(bootstrap, "cached", lambda *_: wheel)
    installed = []
    monkeypatch.setattr(bootstrap, "pip", lambda *words: installed.append(words[-1]))
    bootstrap.VENV.mkdir()
    bootstrap.install_messages()
    bootstrap.install_messages()
    assert installed == [str(wheel)]
    (bootstrap.ROOT / "msg_defs" / "msg" / "Grasp.msg").write_text("float64 width\n")
    bootstrap.install_messages()
    assert len(installed) == 2


# ---- the cache


def test_a_wheel_is_built_once(bootstrap):
    calls = []

    def build(folder):
        calls.append(folder)
        Path(folder, "thing-1-py3-none-any.whl").touch()

    first = bootstrap.cached("thing", "key", build)
    assert first == bootstrap.cached("thing", "key", build)
    assert first.is_file() and len(calls) == 1


def test_a_broken_off_build_is_not_kept(bootstrap):
    def build(folder):
        Path(folder, "thing-1-py3-none-any.whl").touch()
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bootstrap.cached("thing", "key", build)
    assert list(bootstrap.ROOT.glob("cache/**/*.whl")) == []


def test_pins_are_read_with_their_extras(bootstrap):
    assert bootstrap.pin_of("torch") == "2.13.0"
    assert bootstrap.pin_of("ros-jazzy-rclpy") == "7.1.6"
    with pytest.raises(bootstrap.SetupError, match="does not pin nothing"):
        bootstrap.pin_of("nothing")


# ---- choosing the interpreter


def choose(folder: Path, programs: Path, **environment: str):
    """Run tools/setup.sh in ``folder`` with nothing but ``programs`` and coreutils."""
    (folder / "tools").mkdir(exist_ok=True)
    for name in ("setup.sh", "bootstrap.py"):
        (folder / "tools" / name).write_bytes((ROOT / "tools" / name).read_bytes())
    tools = folder / "coreutils"
    tools.mkdir()
    (tools / "dirname").symlink_to("/usr/bin/dirname")
    return subprocess.run(
        ["/bin/sh", str(folder / "tools" / "setup.sh")],
        env={"PATH": f"{programs}{os.pathsep}{tools}", **environment},
        capture_output=True,
        text=True,
    )


def interpreter(version: str) -> str:
    return f'case "$*" in *-c*) echo {version} ;; *) echo "chosen {version} $*" ;; esac'


def test_a_name_that_does_not_run_is_passed_over(tmp_path, programs):
    scripts = {"python3.11": "exit 127", "python3.12": interpreter("3.12")}
    done = choose(tmp_path, programs(**scripts))
    assert done.stdout.startswith("chosen 3.12")
    assert "tools/bootstrap.py" in done.stdout


def test_python_3_11_goes_first(tmp_path, programs):
    scripts = {f"python{v}": interpreter(v) for v in ("3.11", "3.12")}
    assert choose(tmp_path, programs(**scripts)).stdout.startswith("chosen 3.11")


def test_wrong_python_is_told_with_what_was_found(tmp_path, programs):
    scripts = {"python3.11": "exit 127", "python3": interpreter("3.10")}
    done = choose(tmp_path, programs(**scripts))
    assert done.returncode == 1
    assert "wrong Python: 3.11 or 3.12 is needed" in done.stderr
    assert "python3: Python 3.10" in done.stderr
    assert "python3.11: does not run" in done.stderr


def test_a_named_python_is_the_only_candidate(tmp_path, programs):
    scripts = {"python3.11": interpreter("3.11"), "mine": interpreter("3.13")}
    folder = programs(**scripts)
    done = choose(tmp_path, folder, PYTHON=str(folder / "mine"))
    assert done.returncode == 1
    assert "mine: Python 3.13" in done.stderr
