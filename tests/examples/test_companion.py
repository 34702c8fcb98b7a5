"""The examples for a companion computer: the driver's lines, the fake sensors' physics, the services, the rehearsal."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from itertools import islice
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_domain import own_domain
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner
from waiting import HANGS

from ortilo_drake.commands.hil.app import hil_app
from ortilo_drake.interop.recorded.live_rows import why_not_live
from ortilo_drake.interop.recorded.map_file import load_map

FOLDER = Path(__file__).parents[2] / "examples" / "companion"
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="serial ports by termios")
# Lines of a DWM1001, as its firmware's guide prints them for the commands `lec` and `les`.
LEC = (
    "DIST,4,AN0,1151,5.00,8.00,2.25,6.44,AN1,0CA8,0.00,8.00,2.25,6.50,AN2,111C,5.00,0.00,2.25,3.24,"
    "AN3,1150,0.00,0.00,2.25,3.19,POS,2.55,2.01,1.71,98"
)
LES = "1151[5.00,8.00,2.25]=6.48 0CA8[0.00,8.00,2.25]=6.51 111C[5.00,0.00,2.25]=3.18 le_us=2576 est[2.57,1.98,1.68,100]"


def example(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


RANGE_NODE, FAKE = example("range_node"), example("fake_sensors")


@pytest.mark.parametrize(
    ("line", "found"),
    [
        (LEC, [("1151", 6.44), ("0CA8", 6.50), ("111C", 3.24), ("1150", 3.19)]),
        (LES, [("1151", 6.48), ("0CA8", 6.51), ("111C", 3.18)]),
        ("POS,2.55,2.01,1.71,98", []),  # of `lep`
        ("dwm> lec", []),
    ],
)
def test_a_line_gives_its_ranges(line: str, found: list[tuple[str, float]]) -> None:
    assert RANGE_NODE.ranges_in(line) == found


def test_a_line_that_is_cut_short_gives_none() -> None:
    for n in range(LEC.index("3.19") - 1, len("DIST,4"), -1):
        with pytest.raises(ValueError, match="do not hold"):
            RANGE_NODE.ranges_in(LEC[:n])


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (["/uwb/a0CA8", "/uwb/a111c"], ["0CA8", "111C"]),
        (["/uwb/a0CA8", "/uwb/a111c"], ["A0CA8", "A111C"]),
        (["/a0/uwb1150", "/a1/uwb1151"], ["1150", "1151"]),  # beyond what all begin with
        (["/tag/a1", "/tag/a2", "/tag/a11"], ["A1", "A2", "A11"]),
        (["/tag/a1", "/tag/a11"], ["1", "11"]),
        (["/north_east", "/south"], ["NORTH_EAST", "SOUTH"]),
    ],
)
def test_a_topic_ends_with_its_anchor_s_name_of_any_length(topics: list[str], names: list[str]) -> None:
    found = RANGE_NODE.topics_of(topics)
    assert [found[name] for name in names] == topics
    assert not {"", "CA8", "EAST", "NOBODY"} & set(found)


def test_another_tag_needs_another_two_functions(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A tag that prints by itself, in mm; nothing is written to it, and what it says beside is told once."""

    def ranges_in(line: str) -> list[tuple[str, float]]:
        if not line.startswith("$"):
            return []
        _, anchor, mm = line.split(",")
        return [(anchor, int(mm) / 1000.0)]

    monkeypatch.setattr(RANGE_NODE, "ranges_in", ranges_in)
    monkeypatch.setattr(RANGE_NODE, "ask_for_ranges", lambda port: asked.append(port))
    monkeypatch.setattr(RANGE_NODE, "SILENT", 0.1)
    asked = list[int]()
    read, write = os.pipe()
    found = RANGE_NODE.ranges_of(read)
    os.write(write, b"hello\n$D,a1\n$D,a1,x\n$D,a1,500\n$D,b,0\n$D,b,2250\n")
    assert [one[1:] for one in islice(found, 2)] == [("a1", 0.5), ("b", 2.25)]
    assert capsys.readouterr().out.count("'$D,a1' (told once)") == 1
    os.write(write, b"bye\n")
    os.close(write)
    time.sleep(0.15)
    assert list(found) == []
    os.close(read)
    assert set(asked) == {read}


@given(st.lists(st.integers(0, 2 * len(LEC) + 10), max_size=12).map(sorted))
def test_lines_are_stamped_by_their_first_byte_however_they_are_cut_or_come_together(cuts: list[int]) -> None:
    """The port gives a byte every ten bits, and each read what has come since the last one."""
    data, byte = f"{LEC}\r\n{LES}\r\n{LEC}".encode(), 10 * 10**9 // RANGE_NODE.BAUD
    lines, found = RANGE_NODE.Lines(), []
    for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True):
        found += lines.add(1_000 * byte + b * byte, data[a:b])
    assert found == [(1_000 * byte, LEC), ((1_000 + len(LEC) + 2) * byte, LES)]


def test_lines_of_a_burst_are_stamped_after_the_read_before_it_and_in_order() -> None:
    """By USB bytes come faster than at the port's speed."""
    lines = RANGE_NODE.Lines()
    ((first, _),) = lines.add(10_000_000, b"a\n")
    stamps = [t for t, _ in lines.add(11_000_000, 40 * f"{LEC}\n".encode())]
    assert first < 10_000_000 <= stamps[0]
    assert stamps[-1] < 11_000_000
    assert (np.diff(stamps) > 0).all()


def test_the_driver_asks_a_silent_tag_and_stamps_what_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a pseudo-terminal; the fake tag prints nothing before it is asked."""
    monkeypatch.setattr(RANGE_NODE, "SILENT", 0.1)
    anchors = {"0CA8": np.array([0.0, 0.0, 0.3]), "111C": np.array([6.0, 0.0, 2.7])}
    tag, ended = FAKE.Tag(anchors), threading.Event()

    def measures() -> None:
        rng = np.random.default_rng(0)
        while not ended.wait(0.02):
            tag.measure(np.array([3.0, 4.0, 0.3]), rng)

    thread, before = threading.Thread(target=measures), time.time_ns()
    thread.start()
    try:
        port = RANGE_NODE.open_port(tag.name)
        found = list(islice(RANGE_NODE.ranges_of(port), 40))
    finally:
        ended.set()
        thread.join()
    os.close(port)
    stamps = np.array([t for t, _, _ in found])
    assert before <= stamps[0]
    assert (np.diff(stamps) >= 0).all()
    for anchor, r in (("0CA8", 5.0), ("111C", np.sqrt(9.0 + 16.0 + 2.4**2))):
        ranges = [one for _, name, one in found if name == anchor]
        assert len(ranges) == 20
        assert np.mean(ranges) == pytest.approx(r, abs=5 * FAKE.RANGE_SD / np.sqrt(20))


def test_the_fake_imu_measures_the_fake_motion() -> None:
    """Rates and specific force, integrated by SciPy, lead along it."""
    start = {"position": [3.0, 4.0, 0.2], "heading": 0.5}

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        w, f = FAKE.motion(t, start)
        R = Rotation.from_rotvec(x[6:9])
        half, r = np.linalg.norm(x[6:9]) / 2.0, x[6:9]
        k = 1.0 / 12.0 if half < 1e-6 else (1.0 - half / np.tan(half)) / (4.0 * half**2)
        turn = w + 0.5 * np.cross(r, w) + k * np.cross(r, np.cross(r, w))  # Bortz's equation
        return np.concatenate((x[3:6], R.apply(f) - [0.0, 0.0, FAKE.GRAVITY], turn))

    p, R = FAKE.pose(0.0, start)
    found = solve_ivp(
        rates, (0.0, 4.0), np.concatenate((p, np.zeros(3), R.as_rotvec())), rtol=1e-7, atol=1e-9, max_step=0.1
    )
    p, R = FAKE.pose(4.0, start)
    np.testing.assert_allclose(found.y[:3, -1], p, atol=0.01)
    np.testing.assert_allclose(found.y[6:9, -1], R.as_rotvec(), atol=0.002)


def test_the_services_run_what_is_here() -> None:
    units = sorted(FOLDER.glob("*.service"))
    assert len(units) == 3
    for unit in units:
        command = re.search(r"^ExecStart=/bin/bash -c '(.*)'$", unit.read_text(encoding="utf-8"), re.MULTILINE)
        assert command is not None
        subprocess.run(["bash", "-n", "-c", command[1]], check=True)
        if shutil.which("systemd-analyze"):
            told = subprocess.run(["systemd-analyze", "verify", str(unit)], capture_output=True, text=True)
            assert (told.returncode, told.stderr) == (0, "")
    options = re.findall(r"--[a-z-]+", (FOLDER / "ortilo-bridge.service").read_text(encoding="utf-8"))
    told = CliRunner().invoke(hil_app, ["bridge", "--help"]).output
    assert [option for option in options if option not in told] == []


def test_a_service_that_is_restarted_leaves_the_start_out(tmp_path: Path) -> None:
    """The command of the unit, with a program that prints its arguments in place of ortilo."""
    text = (FOLDER / "ortilo-bridge.service").read_text(encoding="utf-8")
    command = re.search(r"^ExecStart=/bin/bash -c '(.*)'$", text, re.MULTILINE)
    assert command is not None
    program = tmp_path / ".venv" / "bin" / "ortilo"
    program.parent.mkdir(parents=True)
    program.write_text('#!/bin/sh\necho "$@"\n')
    program.chmod(0o755)
    env = os.environ | {"RUNTIME_DIRECTORY": str(tmp_path)}
    told = [
        subprocess.run(["bash", "-c", command[1]], cwd=tmp_path, env=env, capture_output=True, text=True).stdout
        for _ in range(2)
    ]
    assert "--map MAP.yaml " in told[0]
    assert "--map MAP_in_air.yaml " in told[1]
    assert all(f"--state {tmp_path}/state.npz " in one for one in told)  # what the first kept, the second reads


@pytest.mark.long
@pytest.mark.skipif(
    importlib.util.find_spec("rclpy") is None or importlib.util.find_spec("pymavlink") is None,
    reason="needs the extras ros2 and mavlink",
)
def test_the_rehearsal_as_a_user_runs_it() -> None:
    """How often ODOMETRY comes depends on the machine, and is not asked."""
    command = [sys.executable, str(FOLDER / "rehearsal.py"), "--seconds", "8"]
    with own_domain():
        told = subprocess.run(command, capture_output=True, text=True, timeout=HANGS).stdout
    assert "STATUSTEXT 5: the filter has begun" in told
    assert int(re.search(r"^(\d+) ODOMETRY at ", told, re.MULTILINE)[1]) > 20  # type: ignore[index]
    assert "the estimate is wrong" not in told


def test_the_rehearsal_s_map_can_be_heard_live() -> None:
    assert why_not_live(load_map(FOLDER / "room.yaml")) is None
