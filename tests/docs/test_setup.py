"""scripts/setup.sh installs system packages only where it may; apt-get and all else are stubs."""

import os
import pty
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "setup.sh"
STUB = '#!/bin/sh\necho "$(basename "$0") $*" >> "$RECORD"\n'
LACKING = 'echo "a library that nobody needs"'  # what `ldconfig -p` prints


class Machine(NamedTuple):
    """A checkout beside stubs of what the script calls."""

    folder: Path
    env: dict[str, str]

    def called(self) -> list[str]:
        record = self.folder / "record"
        return record.read_text(encoding="utf-8").splitlines() if record.exists() else []


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    (tmp_path / "scripts").mkdir()
    shutil.copy(SCRIPT, tmp_path / "scripts")
    for name in ("ortilo_drake", "diagrams", "bin"):
        (tmp_path / name).mkdir()
    stubs = {f"bin/{name}": STUB for name in ("apt-get", "python3", "dot", "chromium")} | {".venv/bin/python": STUB}
    stubs |= {"bin/ldconfig": f"#!/bin/sh\n{LACKING}\n", "bin/id": "#!/bin/sh\necho 0\n"}
    (tmp_path / ".venv/bin").mkdir(parents=True)
    for path, text in stubs.items():
        (tmp_path / path).write_text(text, encoding="utf-8")
        (tmp_path / path).chmod(0o755)
    env = {name: value for name, value in os.environ.items() if name not in ("CI", "YES", "VENV", "PYTHON")}
    return Machine(tmp_path, env | {"PATH": f"{tmp_path / 'bin'}:/usr/bin:/bin", "RECORD": str(tmp_path / "record")})


def set_up(machine: Machine, **env: str) -> "subprocess.CompletedProcess[str]":
    """Run the script where nobody can be asked."""
    return subprocess.run(
        ["bash", "scripts/setup.sh"],
        cwd=machine.folder,
        env=machine.env | env,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
    )


def set_up_in_terminal(machine: Machine, answer: str) -> tuple[int, str]:
    """Run the script in a terminal, give it an answer; return its exit code and what was to be read."""
    ours, its = pty.openpty()
    process = subprocess.Popen(
        ["bash", "scripts/setup.sh"], cwd=machine.folder, env=machine.env, stdin=its, stdout=its, stderr=its
    )
    os.close(its)
    os.write(ours, f"{answer}\n".encode())
    said = b""
    try:
        while chunk := os.read(ours, 4096):
            said += chunk
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    return process.wait(), said.decode()


def of_apt(machine: Machine) -> list[str]:
    return [line for line in machine.called() if line.startswith("apt-get ")]


def test_without_apt_get_nothing_is_installed_and_one_line_says_what_to_do(machine: Machine) -> None:
    (machine.folder / "bin/apt-get").unlink()
    if shutil.which("apt-get", path=machine.env["PATH"]):
        machine.env["PATH"] = str(machine.folder / "bin")
        for tool in ("bash", "dirname", "grep", "find", "basename", "cat"):
            (machine.folder / "bin" / tool).symlink_to(shutil.which(tool) or "")
    done = set_up(machine)
    assert done.returncode != 0
    assert of_apt(machine) == []
    (line,) = done.stderr.splitlines()
    assert "sudo apt-get install libgl1 libx11-6 libgomp1 libegl1" in line
    assert "YES=1" in line


@pytest.mark.parametrize("env", [{"CI": "true"}, {"YES": "1"}, {}])
def test_where_it_may_it_installs_what_is_missing_and_goes_on(machine: Machine, env: dict[str, str]) -> None:
    done = set_up(machine, **env)
    assert done.returncode == 0, done.stderr
    update, install = of_apt(machine)
    assert update.split()[1] == "update"
    assert install.split()[1] == "install"
    assert {"libgl1", "libx11-6", "libgomp1", "libegl1"} <= set(install.split())
    assert machine.called()[-1].startswith("python -m pip install")
    assert len(done.stderr.splitlines()) <= 3


@pytest.mark.parametrize(("answer", "installs"), [("y", True), ("", False), ("n", False), ("never", False)])
def test_in_a_terminal_it_asks(machine: Machine, answer: str, installs: bool) -> None:
    code, said = set_up_in_terminal(machine, answer)
    assert "Install with apt-get, as root? [y/N]" in said
    assert bool(of_apt(machine)) == installs
    assert (code == 0) == installs


def test_where_nothing_is_missing_nobody_is_asked(machine: Machine) -> None:
    libraries = "libGL.so.1 libX11.so.6 libgomp.so.1 libEGL.so.1"
    (machine.folder / "bin/ldconfig").write_text(f"#!/bin/sh\nprintf '%s\\n' {libraries}\n", encoding="utf-8")
    if not list(Path("/usr/lib").glob("*/dri/*_dri.so")):
        pytest.skip("Mesa's drivers are missing here, which the script looks for below /usr/lib itself")
    done = set_up(machine)
    assert done.returncode == 0, done.stderr
    assert of_apt(machine) == []
