"""What is exported flies with the bits of Python: compiled as a stranger would, here and under qemu."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
from command_line import run

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import BOARDS, STRICT, build, programs_of
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.codegen.targets import TARGETS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario


def needs(*programs: str) -> None:
    missing = [program for program in programs if shutil.which(program) is None]
    if missing:
        pytest.skip(f"{', '.join(missing)}: not installed (make setup EXPORT=1 YES=1)")


def do(*command: object, folder: Path) -> str:
    done = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def compiled(folder: Path, target: str) -> list[str]:
    """Build test_golden of an export for its target; return the command that runs it."""
    needs(*programs_of(target))
    build(folder, target, folder / "test_golden.c", folder / "golden")
    if target in BOARDS:
        return ["qemu-system-arm", "-M", BOARDS[target], "-nographic", "-semihosting", "-kernel", "golden"]
    return ["qemu-aarch64", "./golden"] if target == "aarch64" else ["./golden"]


@pytest.mark.parametrize("name", ["nominal_imu_uwb", pytest.param("imu_uwb", marks=pytest.mark.long)])
@pytest.mark.parametrize("target", TARGETS)
def test_every_bit_is_pythons(name: str, target: str, tmp_path: Path) -> None:
    export(load_scenario(name), target, tmp_path)
    assert do(*compiled(tmp_path, target), folder=tmp_path) == "0 of 300 ticks differ\n"


def test_the_golden_test_notices_a_bit(tmp_path: Path) -> None:
    export(load_scenario("nominal_imu_uwb"), "x86-64", tmp_path, ticks=20)
    source = (tmp_path / "ortilo.c").read_text()
    mass = load_scenario("nominal_imu_uwb").vehicle.mass
    said = f".mass = {mass.hex()}"
    assert said in source
    (tmp_path / "ortilo.c").write_text(source.replace(said, f".mass = {(mass * (1.0 + 2**-52)).hex()}", 1))
    command = compiled(tmp_path, "x86-64")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert int(done.stdout.split()[0]) > 0


@pytest.mark.parametrize("compiler", [("gcc", "-std=c99"), ("clang", "-std=c11"), ("g++", "-std=c++17")])
def test_compilers_find_nothing_to_say_of_the_header(compiler: tuple[str, str], tmp_path: Path) -> None:
    needs(compiler[0])
    export(load_scenario("nominal_imu_uwb"), "x86-64", tmp_path, ticks=1)
    name = "use.cpp" if compiler[0] == "g++" else "use.c"
    (tmp_path / name).write_text(
        '#include "ortilo.h"\nint use(ortilo *o);\nint use(ortilo *o) { return o->state.tick > 0; }\n'
    )
    do(*compiler, *STRICT, "-pedantic", "-c", name, folder=tmp_path)


def test_a_strangers_project_links_the_folder(tmp_path: Path) -> None:
    needs("gcc", "cmake")
    export(load_scenario("nominal_imu_uwb"), "x86-64", tmp_path / "half", ticks=20)
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.16)\nproject(stranger C)\nenable_testing()\nadd_subdirectory(half)\n"
    )
    do("cmake", "-S", ".", "-B", "build", folder=tmp_path)
    do("cmake", "--build", "build", folder=tmp_path)
    assert "100% tests passed" in do("ctest", "--test-dir", "build", folder=tmp_path)


@pytest.mark.parametrize(
    ("name", "changes", "says"),
    [
        ("nominal_imu_uwb_yolo", ("camera.kind=rendered",), "export: camera.kind: rendered: "),
    ],
)
def test_what_cannot_be_exported_is_refused_in_a_line(name: str, changes: tuple[str, ...], says: str) -> None:
    with pytest.raises(InputError) as refused:
        onboard_half(load_scenario(name, changes))
    assert str(refused.value).startswith(says)
    assert "\n" not in str(refused.value)


def test_a_processor_that_is_not_there_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("export", "nominal_imu_uwb", "--target", "z80", "--out", str(tmp_path / "half")) == 2
    assert capsys.readouterr().err == "ortilo: --target: 'z80': must be one of cortex-m7, cortex-m4, aarch64, x86-64\n"
    assert not (tmp_path / "half").exists()


def test_the_manifest_says_what_was_exported(tmp_path: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb")
    export(scenario, "cortex-m7", tmp_path, ticks=1)
    told = json.loads((tmp_path / "manifest.json").read_text())
    assert told["scenario"] == json.loads(scenario.model_dump_json())
    assert told["object_bytes"] == (tmp_path / "ortilo_elements.o").stat().st_size
