"""ortilo doctor: each check by a stub of what it looks at, and the command as a whole."""

import json
import os
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import pytest
from command_line import run

from ortilo_drake.commands import doctor as doctor_checks
from ortilo_drake.commands.doctor import CHECKS, NEEDED, Finding


@pytest.fixture
def nothing_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(package: str) -> str:
        raise doctor_checks.PackageNotFoundError(package)

    monkeypatch.setattr(doctor_checks, "version", version)
    monkeypatch.setattr(shutil, "which", lambda name: None)


def test_what_is_not_installed_is_said_with_what_brings_it(nothing_installed: None) -> None:
    extras = {"onnxruntime": "onnx", "torch": "torch", "videos": "video", "recordings": "rerun", "OpenCV": "camera"}
    extras |= {"logs and bags": "log", "maps": "map", "worker processes": "workers"}
    found = {finding.name: finding for finding in (check() for check in CHECKS if check is not doctor_checks.pictures)}
    for name, extra in extras.items():
        assert (found[name].is_there, found[name].found) == (False, "not installed")
        assert f"'ortilo-drake[{extra}]'" in found[name].mend
    assert not doctor_checks.drake().is_there
    assert "apt-get install graphviz" in doctor_checks.graphviz().mend
    assert not doctor_checks.browser().is_there


def test_two_packages_of_opencv_are_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    there = {"opencv-python": "4.1", "opencv-python-headless": "5.0"}
    monkeypatch.setattr(doctor_checks, "_installed", lambda package: there.get(package, ""))
    found = doctor_checks.opencv()
    assert not found.is_there
    assert all(name in found.found for name in there)
    there.pop("opencv-python")
    assert doctor_checks.opencv().is_there


@pytest.mark.parametrize(
    ("name", "release", "said", "there"),
    [
        ("Linux", "6.1.0-13-amd64", "Linux", True),
        ("Linux", "5.15.153.1-microsoft-standard-WSL2", "WSL2", True),
        ("Darwin", "23.4.0", "macOS", True),
        ("Windows", "10", "Windows", False),
    ],
)
def test_the_machine_is_named_and_windows_by_itself_is_none(
    name: str, release: str, said: str, there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor_checks.platform, "system", lambda: name)
    monkeypatch.setattr(doctor_checks.platform, "release", lambda: release)
    found = doctor_checks.machine()
    assert (found.found.split()[0], found.is_there, found.weight) == (said, there, NEEDED)
    installs = "brew install graphviz" if said == "macOS" else "apt-get install graphviz"
    monkeypatch.setattr(shutil, "which", lambda name: None)
    assert installs in doctor_checks.graphviz().mend


@pytest.mark.parametrize(("size", "enough"), [(64e6, False), (256e6, True)])
def test_little_shared_memory_is_told_of(size: float, enough: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(size, 0, size))
    assert doctor_checks.shared_memory().is_there == enough


def test_a_picture_is_drawn_or_the_reason_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor_checks, "_PICTURE", "import os; os.abort()")  # as a renderer without a driver ends
    found = doctor_checks.pictures()
    assert (found.is_there, found.found) == (False, "exit code -6")
    monkeypatch.setattr(doctor_checks, "_PICTURE", "raise RuntimeError('no device')")
    assert doctor_checks.pictures().found == "RuntimeError: no device"
    monkeypatch.setattr(doctor_checks, "_PICTURE", "import time; time.sleep(60)")
    monkeypatch.setattr(doctor_checks, "LIMIT", 0.2)
    assert "none within" in doctor_checks.pictures().found


def test_a_folder_that_cannot_be_written_keeps_no_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert doctor_checks.kernels() == Finding(
        "compiled functions kept", True, "wanted", str(tmp_path), doctor_checks.kernels().mend
    )
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert not doctor_checks.kernels().is_there


def test_little_room_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    Usage = namedtuple("Usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(10, 9, int(0.4e9)))
    found = doctor_checks.disk()
    assert (found.is_there, found.found) == (False, "0.4 GB free here")
    monkeypatch.setattr(os, "sysconf", lambda name: {"SC_AVPHYS_PAGES": 250_000, "SC_PAGE_SIZE": 4096}[name])
    assert doctor_checks.memory().found == "1.0 GB free"


def test_a_zeromq_without_encryption_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    assert doctor_checks.encrypted_link().is_there
    monkeypatch.setattr("zmq.has", lambda feature: feature != "curve")
    found = doctor_checks.encrypted_link()
    assert (found.is_there, found.mend) == (False, "pip install pyzmq, as a wheel")
    assert found.found.endswith("without CURVE")


@pytest.mark.long
def test_here_all_that_is_needed_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "doctor.json"
    assert run("doctor", "--json", str(file)) == 0
    said = capsys.readouterr().out
    findings = json.loads(file.read_text())
    assert len(findings) == len(CHECKS)
    assert said.count("OK ") == sum(finding["is_there"] for finding in findings)
    assert "everything that flights need is here" in said
    assert next(f for f in findings if f["name"] == "Python")["found"] in sys.version


def test_without_drake_the_command_says_so_and_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    gone = Finding("Drake", False, NEEDED, "not installed", "pip install drake")
    monkeypatch.setattr(doctor_checks, "CHECKS", (doctor_checks.python, lambda: gone))
    assert run("doctor") == 1
    said = capsys.readouterr().out
    assert "missing: Drake" in said
    assert "pip install drake" in said


@pytest.mark.long
def test_the_picture_that_is_drawn_is_one() -> None:
    done = subprocess.run(
        [sys.executable, "-c", doctor_checks._PICTURE + "print(image.data.shape)"], capture_output=True
    )
    assert done.stdout.decode().split() == ["(16,", "16,", "4)"], done.stderr.decode()
