# SPDX-License-Identifier: Apache-2.0
"""Sets up .venv: checks first, then pinned packages, messages, and this package.

Called by `make` through tools/setup.sh, with nothing but the standard library. A stamp
in .venv makes the second call return at once; an interrupted call goes on where it was.
"""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMP = VENV / "neugrasp.stamp"
INSTALLED_MESSAGES = VENV / "neugrasp_msgs.key"
LOG = VENV / "setup.log"
INPUTS = (
    "requirements.txt", "requirements-dev.txt", "constraints.txt",
    "setup.py", "setup.cfg", "package.xml", "tools/bootstrap.py",
)  # fmt: skip
VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"
OLDEST_GLIBC = (2, 35)  # what the ROS wheels were linked against
DISK_GB = 6.0  # 3.4 in .venv, the rest for pip's cache and the builds
CUDA_DISK_GB = 16.0
OFFLINE = "no network: pip finds no package {}; check the connection or pip's settings"
REPORT_PERIOD = 5.0  # between two lines of progress [s]


class SetupError(Exception):
    """The environment cannot be set up; the message says why in one sentence."""


def main() -> int:
    """Bring .venv up to date and return the exit code."""
    for name in ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "PYTHONPATH", "PYTHONHOME"):
        os.environ.pop(name, None)  # another environment's, if set
    if PYTHON.exists() and STAMP.is_file() and STAMP.read_text() == stamp():
        return 0
    started = time.monotonic()
    try:
        check_machine()
        make_venv()
        install()
    except SetupError as error:
        print(f"make: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("make: interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    STAMP.write_text(stamp())
    print(f"make: .venv is ready after {time.monotonic() - started:.0f} s")
    return 0


# ---- what must hold before anything is installed


def check_machine() -> None:
    """Raise SetupError with one sentence for each thing that is missing."""
    checks = (check_platform, check_venv_module, check_compiler, check_disk)
    problems = [sentence for check in checks if (sentence := check())]
    if problems:
        raise SetupError("\nmake: ".join(problems))


def check_platform() -> str:
    """Return what is wrong with the system's C library, or nothing."""
    needed = ".".join(map(str, OLDEST_GLIBC))
    wanted = f"glibc {needed} or newer is needed (Debian 12, Ubuntu 22.04), found"
    if not sys.platform.startswith("linux"):
        return f"wrong system: Linux with {wanted} {sys.platform}"
    found = run_quietly(["getconf", "GNU_LIBC_VERSION"]).strip()
    numbers = re.search(r"(\d+)\.(\d+)", found)
    if not numbers or tuple(map(int, numbers.groups())) < OLDEST_GLIBC:
        return f"old C library: {wanted} {found or 'another C library'}"
    return ""


def check_venv_module() -> str:
    """Return whether Python lacks what makes a virtual environment, or nothing."""
    if run([base_python(), "-I", "-c", "import venv, ensurepip"]):
        return (
            f"no venv module: {base_python()} can't make a virtual environment; "
            f"install python{VERSION}-venv"
        )
    return ""


def check_compiler() -> str:
    """Return what is missing to compile the messages, or nothing."""
    compiler = os.environ.get("CXX", "g++")
    program = b"#include <vector>\nint main() {}\n"
    if run([*compiler.split(), "-x", "c++", "-fsyntax-only", "-"], program):
        return (
            f"no compiler: {compiler} does not compile C++, which builds the messages; "
            "install g++ (Debian, Ubuntu: apt install g++)"
        )
    if not Path(sysconfig.get_path("include"), "Python.h").is_file():
        return (
            f"no Python headers: Python.h of {base_python()} is missing, which builds "
            f"the messages; install python{VERSION}-dev"
        )
    return ""


def check_disk(needed: float = DISK_GB) -> str:
    """Return how much disk is missing in [GB], or nothing."""
    installed = STAMP.is_file() or (VENV / "bin" / "mypy").is_file()
    free = shutil.disk_usage(ROOT).free / 1e9
    if free < needed and not installed:
        return f"too little disk: {needed:.0f} GB are needed in {ROOT}, {free:.1f} free"
    return ""


# ---- the environment, step by step


def make_venv() -> None:
    """Make .venv, anew when it is another Python's, another folder's, or half made."""
    if VENV.exists() and not is_usable():
        say("removing .venv: unfinished, moved, or of another Python")
        shutil.rmtree(VENV)
    if not VENV.exists():
        say(f"making .venv with {base_python()} ({sys.version.split()[0]})")
        run_logged([base_python(), "-I", "-m", "venv", str(VENV)])


def is_usable() -> bool:
    """Return whether .venv has this Python's version, this folder, and pip."""
    settings = VENV / "pyvenv.cfg"
    if not settings.is_file():
        return False
    made_by = re.search(r"^version = (\S+)", settings.read_text(), re.MULTILINE)
    if not made_by or made_by[1] != sys.version.split()[0]:
        return False
    script = VENV / "bin" / "pip"
    here = script.is_file() and str(VENV) in script.read_text().splitlines()[0]
    return here and not run([str(PYTHON), "-I", "-m", "pip", "--version"])


def install() -> None:
    """Install the pinned packages, the messages, and this package."""
    index = torch_index()
    if VERSION == "3.12":
        install_pybullet()
    say("installing the pinned packages (about 1 GB to download the first time)")
    files = ["-r", "requirements.txt", "-r", "requirements-dev.txt"]
    pip("install", "-c", "constraints.txt", *files, *index)
    install_messages()
    say("installing neugrasp_ros")
    pip("install", "--no-deps", "--no-build-isolation", "-e", ".")
    pip("check")
    say("compiling the kernels, so that the first decision need not wait for it")
    run_logged([str(VENV / "bin" / "neugrasp"), "warm"])


def install_messages() -> None:
    """Install the messages, unless these very ones are installed."""
    key = messages_key()
    if INSTALLED_MESSAGES.is_file() and INSTALLED_MESSAGES.read_text() == key:
        return
    wheel = cached("neugrasp_msgs", key, build_messages)
    say(f"installing the messages from {wheel.parent}")
    pip("install", "--no-deps", "--force-reinstall", str(wheel))
    INSTALLED_MESSAGES.write_text(key)


def torch_index() -> list[str]:
    """Return pip's options for torch; say so when only its CUDA build is in reach.

    Raises:
        SetupError: If no index answers, or the disk is too small for CUDA.
    """
    address = os.environ.get("TORCH_INDEX", "")
    options = ["--extra-index-url", address] if address else []
    wanted = pin_of("torch")
    command = [str(PYTHON), "-I", "-m", "pip", "index", "versions", "torch", *options]
    versions = re.split(r"[,\s]+", run_quietly(command))
    if wanted not in versions and f"{wanted}+cpu" not in versions:
        raise SetupError(OFFLINE.format(f"torch=={wanted}"))
    if f"{wanted}+cpu" not in versions:
        say(
            f"only the CUDA build of torch {wanted} is in pip's reach: about 3 GB to "
            "download, 8 GB on disk. For the CPU build interrupt now and name the "
            "index of PyTorch's CPU wheels (pytorch.org, Get started): "
            "make setup TORCH_INDEX=https://... Going on."
        )
        if problem := check_disk(CUDA_DISK_GB):
            raise SetupError(problem)
    return options


def install_pybullet() -> None:
    """Install pybullet from the cache; it has no wheel for Python 3.12.

    Its build looks for numpy in the running environment, without which images come
    out as tuples, so numpy goes first and the build is not isolated.
    """
    tools = [f"{name}=={pin_of(name)}" for name in ("numpy", "setuptools", "wheel")]
    pip("install", *tools)
    pin = f"pybullet=={pin_of('pybullet')}"

    def build(folder: str) -> None:
        say("building pybullet, once for this user (about 10 minutes)")
        os.environ.setdefault("CFLAGS", "-g0")  # faster, and a tenth of the size
        pip("wheel", "--no-deps", "--no-build-isolation", "-w", folder, pin)

    key = f"{pin}-numpy{pin_of('numpy')}-cp{VERSION}"
    pip("install", "--no-deps", str(cached("pybullet", key, build)))


def build_messages(folder: str) -> None:
    """Compile msg_defs into a wheel in ``folder``."""
    say("building the messages, once for this user (3 to 6 minutes)")
    with tempfile.TemporaryDirectory() as copy:  # pip would leave files in msg_defs
        source = shutil.copytree(ROOT / "msg_defs", Path(copy, "msg_defs"))
        pip("wheel", "-v", "--no-deps", "-w", folder, str(source))


def cached(name: str, key: str, build: Callable[[str], None]) -> Path:
    """Return the wheel ``name`` of ``key`` from the user's cache, building it first."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = home / "neugrasp" / f"{name}-{key}"
    wheels = list(folder.glob("*.whl"))
    if not wheels:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as unfinished:
            build(unfinished)
            for wheel in Path(unfinished).glob("*.whl"):
                wheels.append(wheel.rename(folder / wheel.name))
    return wheels[0]


# ---- keys


def messages_key() -> str:
    """Return a key of the definitions, their build, the Python version, the machine."""
    files = [p for p in sorted((ROOT / "msg_defs").rglob("*")) if p.suffix != ".pyc"]
    machine = f"cp{VERSION}-{os.uname().machine}"
    return f"{digest([p for p in files if p.is_file()])[:16]}-{machine}"


def stamp() -> str:
    """Return what the environment was made from, one thing a line."""
    files = digest([ROOT / name for name in INPUTS])
    return f"{VENV}\n{sys.version.split()[0]}\n{files}\n{messages_key()}\n"


def digest(files: list[Path]) -> str:
    """Return one hash of the names and contents of ``files``."""
    code = hashlib.sha256()
    for path in files:
        code.update(f"{path.relative_to(ROOT)}\0".encode() + path.read_bytes() + b"\0")
    return code.hexdigest()


def pin_of(name: str) -> str:
    """Return the version that requirements.txt pins ``name`` to."""
    text = (ROOT / "requirements.txt").read_text()
    found = re.search(rf"^{re.escape(name)}(?:\[\w+\])?==(\S+)", text, re.MULTILINE)
    if not found:
        raise SetupError(f"requirements.txt does not pin {name}")
    return found[1]


def base_python() -> str:
    """Return the running interpreter, or the one under .venv if that is running."""
    return str(getattr(sys, "_base_executable", None) or sys.executable)


# ---- processes


def say(text: str) -> None:
    """Print one line of progress."""
    print(f"make: {text}", flush=True)


def run(command: list[str], stdin: bytes = b"") -> int:
    """Run without output and return the exit code, 127 if there is no such program."""
    try:
        return subprocess.run(command, input=stdin, capture_output=True).returncode
    except OSError:
        return 127


def run_quietly(command: list[str]) -> str:
    """Return what a command prints, nothing if it fails."""
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except OSError:
        return ""
    return done.stdout if done.returncode == 0 else ""


def pip(*arguments: str) -> None:
    """Run .venv's pip from the repository's root."""
    run_logged([str(PYTHON), "-I", "-m", "pip", "--no-input", *arguments])


def run_logged(command: list[str]) -> None:
    """Run a command with its output in .venv's log; print a line now and then.

    Raises:
        SetupError: If it fails, with the log's last lines.
    """
    lines = [f"$ {' '.join(command)}"]
    started = shown = time.monotonic()
    with subprocess.Popen(
        command,
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    ) as process:
        for line in process.stdout or ():
            lines.append(line.rstrip())
            if time.monotonic() - shown > REPORT_PERIOD and line.strip():
                shown = time.monotonic()
                print(f"  {shown - started:4.0f} s  {line.strip()[:100]}", flush=True)
    if VENV.is_dir():
        with LOG.open("a") as log:
            log.write("\n".join(lines) + "\n")
    if process.returncode:
        tail = "\n  ".join(lines[-15:])
        raise SetupError(f"this step failed, the whole log is {LOG}:\n  {tail}")


if __name__ == "__main__":
    sys.exit(main())
