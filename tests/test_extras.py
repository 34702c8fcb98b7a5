"""An environment without extras: what must work there works, and what cannot names the extra that it needs."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from ortilo_drake.model.optional import EXTRAS, later
from ortilo_drake.model.typed_yaml import InputError

pytestmark = pytest.mark.processes
BLOCKED = f"import sys; sys.modules.update(dict.fromkeys({sorted(EXTRAS)}))\n"
COMMAND = BLOCKED + "from ortilo_drake.cli import main; sys.argv[0] = 'ortilo'; main()"
HOVER = ["--set", "planner={kind: hover, duration: 0.5}", "--set", "settle=0"]


def run(folder: Path, code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=500, check=False, cwd=folder
    )


def test_each_package_of_an_extra_is_in_that_extra_and_is_no_dependency() -> None:
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    name_of = {"cv2": "opencv-python-headless"}
    for package, extra in EXTRAS.items():
        name = name_of.get(package, package)
        assert [line for line in project["optional-dependencies"][extra] if re.match(rf"{name}\b", line)], package
        assert not [line for line in project["dependencies"] if re.match(rf"{name}\b", line)], package


def test_python_flies_without_extras(tmp_path: Path) -> None:
    code = (
        "import ortilo_drake as od\n"
        "flight = od.fly('imu_uwb', planner={'kind': 'hover', 'duration': 0.5}, settle=0.0)\n"
        "assert flight.lost is None\n"
    )
    done = run(tmp_path, BLOCKED + code)
    assert done.returncode == 0, done.stderr


def test_a_flight_is_flown_and_written_without_extras(tmp_path: Path) -> None:
    done = run(tmp_path, COMMAND, "fly", "imu_uwb", *HOVER, "--out", "one.nc", "--html", "one.html", "--png", "one.png")
    assert done.returncode == 0, done.stderr
    assert {"one.nc", "one.html", "one.png"} <= {file.name for file in tmp_path.iterdir()}


@pytest.mark.long
def test_a_scenario_is_analysed_without_extras(tmp_path: Path) -> None:
    done = run(tmp_path, COMMAND, "analyze", "nominal_imu_uwb", "--flights", "3")
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "extra"),
    [
        (["fly", "imu_uwb", *HOVER, "--log", "log"], "log"),
        (["replay", "log"], "log"),
        (["tables", "--workers", "2"], "workers"),
        (["--scheduler", "tcp://127.0.0.1:8786", "tables"], "workers"),
        (["room", "trace", "plan.png", "--scale", "20", "--out", "room.yaml"], "camera"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else value,
)
def test_a_command_that_misses_a_package_names_its_extra_in_a_line(
    arguments: list[str], extra: str, tmp_path: Path
) -> None:
    from PIL import Image

    Image.new("L", (100, 100), 255).save(tmp_path / "plan.png")
    done = run(tmp_path, COMMAND, *arguments)
    assert done.returncode == 2
    assert re.fullmatch(rf"ortilo: [\w .:]*: is not installed.*: pip install 'ortilo-drake\[{extra}\]'\n", done.stderr)


def test_a_module_is_imported_when_it_is_first_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    module = later("pyarrow")
    with pytest.raises(InputError, match=r"pip install 'ortilo-drake\[map\]'"):
        module.table  # noqa: B018 - it is the use of it that is refused
