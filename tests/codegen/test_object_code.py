"""What is exported flies with the bits of Python: compiled as a stranger would, here and under qemu."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from itertools import product
from pathlib import Path

import mpmath
import numpy as np
import pytest
from command_line import run
from exports import SHORT, Exported, do, golden, needs
from test_exported_half import flown_by

from ortilo_drake.codegen.c_source import SUM_TEXT, number_text, values_text
from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import STRICT, build, emulated, programs_of
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.codegen.object_code import object_code
from ortilo_drake.codegen.targets import TARGETS
from ortilo_drake.flight.lockstep import fly_lockstep, in_this_process
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario


def test_every_bit_is_pythons(short: Scenario, exported: Exported, tmp_path: Path) -> None:
    assert do(*golden(exported(short), "x86-64", tmp_path), folder=tmp_path) == "0 of 60 ticks differ\n"


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "target"),
    [
        *product(("nominal_imu_uwb", "imu_uwb", "flow"), TARGETS),
        ("tight_differences", "x86-64"),
        ("tight_imu_uwb", "cortex-m4"),
    ],
)
def test_every_bit_is_pythons_on_each_processor(name: str, target: str, exported: Exported, tmp_path: Path) -> None:
    needs(*programs_of(target))
    folder = exported(load_scenario(name), target, ticks=300)
    assert do(*golden(folder, target, tmp_path), folder=tmp_path) == "0 of 300 ticks differ\n"


def test_the_golden_test_notices_a_bit(short: Scenario, exported: Exported, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(exported(short), tmp_path / "half"))
    source, mass = (folder / "ortilo.c").read_text(), short.vehicle.mass
    said = f".mass = {mass.hex()}"
    assert said in source
    (folder / "ortilo.c").write_text(source.replace(said, f".mass = {(mass * (1.0 + 2**-52)).hex()}", 1))
    done = subprocess.run(golden(folder, "x86-64", tmp_path), capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert int(done.stdout.split()[0]) > 0


@pytest.mark.parametrize("compiler", [("gcc", "-std=c99"), ("clang", "-std=c11"), ("g++", "-std=c++17")])
def test_compilers_find_nothing_to_say_of_the_header(
    compiler: tuple[str, str], short: Scenario, exported: Exported, tmp_path: Path
) -> None:
    needs(compiler[0])
    name = "use.cpp" if compiler[0] == "g++" else "use.c"
    (tmp_path / name).write_text(
        '#include "ortilo.h"\nint use(ortilo *o);\nint use(ortilo *o) { return o->state.tick > 0; }\n'
    )
    do(*compiler, *STRICT, "-pedantic", "-I", exported(short), "-c", name, folder=tmp_path)


STRANGER = """
cmake_minimum_required(VERSION 3.16)
project(stranger C)
enable_testing()
add_subdirectory(half)
add_executable(stranger stranger.c)
target_compile_options(stranger PRIVATE -Wall -Wextra -Wconversion -Werror)
target_link_libraries(stranger PRIVATE ortilo)
add_test(NAME stranger COMMAND stranger)
"""
ITS_MAIN = """
#include "ortilo.h"
int main(void) {
    static ortilo half;
    static ortilo_inputs inputs;
    static ortilo_outputs outputs;
    ortilo_init(&half, 0);
    const int stopped = ortilo_tick(&half, &inputs, &outputs);
    return stopped != 0 || !(outputs.control[0] > 0.0) || half.state.tick != 1;
}
"""


@pytest.mark.long
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_a_strangers_project_links_the_folder(compiler: str, exported: Exported, tmp_path: Path) -> None:
    needs(compiler, "cmake")
    shutil.copytree(exported(load_scenario("nominal_imu_uwb"), ticks=300), tmp_path / "half")
    (tmp_path / "CMakeLists.txt").write_text(STRANGER)
    (tmp_path / "stranger.c").write_text(ITS_MAIN)
    do("cmake", "-S", ".", "-B", "build", f"-DCMAKE_C_COMPILER={compiler}", folder=tmp_path)
    do("cmake", "--build", "build", folder=tmp_path)
    said = do("ctest", "--test-dir", "build", "--verbose", folder=tmp_path)
    assert "0 of 300 ticks differ" in said
    assert "100% tests passed, 0 tests failed out of 2" in said


@pytest.mark.long
@pytest.mark.parametrize("target", TARGETS)
def test_the_folder_builds_and_tests_itself_by_cmake(target: str, exported: Exported, tmp_path: Path) -> None:
    needs("cmake", *programs_of(target))
    folder = Path(shutil.copytree(exported(load_scenario("nominal_imu_uwb"), target, ticks=300), tmp_path / "half"))
    commands = [line.strip() for line in (folder / "README.md").read_text().splitlines() if line.startswith("    c")]
    assert len(commands) == 3  # configure, build, test, as the README says
    said = [do(*command.split(), *(["-V"] if "ctest" in command else []), folder=folder) for command in commands]
    assert "0 of 300 ticks differ" in said[-1]


@pytest.mark.long
@pytest.mark.parametrize("target", ["cortex-m7", "aarch64"])
def test_cmake_refuses_another_processors_compiler(target: str, exported: Exported, tmp_path: Path) -> None:
    needs("cmake", "gcc")
    folder = exported(load_scenario("nominal_imu_uwb"), target, ticks=300)
    done = subprocess.run(["cmake", "-S", folder, "-B", tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert f"ortilo_elements.o is for {target}: configure with -DCMAKE_TOOLCHAIN_FILE" in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("name", "kind", "says"),
    [
        ("nominal_imu_uwb_yolo", "rendered", "export: camera.kind: rendered: "),
        ("paper_imu_uwb_yolo", "projected", "export: landmark_fix.method: cosine_law: "),
    ],
)
def test_what_cannot_be_exported_is_refused_in_a_line(name: str, kind: str, says: str) -> None:
    with pytest.raises(InputError) as refused:
        onboard_half(load_scenario(name, f"camera.kind={kind}"))
    assert str(refused.value).startswith(says)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("target", ["cortex-m7", "cortex-m4", "aarch64"])
def test_a_function_of_the_processors_library_is_refused_in_a_line(target: str) -> None:
    cosine = "declare double @llvm.cos.f64(double)\ndefine void @ortilo_f(ptr %x) {\n %a = load double, ptr %x\n"
    cosine += " %c = call double @llvm.cos.f64(double %a)\n store double %c, ptr %x\n ret void\n}\n"
    with pytest.raises(InputError) as refused:
        object_code({"ortilo_f": cosine}, TARGETS[target])
    assert str(refused.value) == "export: ortilo_f: calls llvm.cos.f64 of the processor's library, which has other bits"
    assert object_code({"ortilo_f": cosine.replace("cos", "fabs")}, TARGETS[target])


EXACT = """
declare double @llvm.floor.f64(double)
declare double @llvm.rint.f64(double)
define void @ortilo_f(ptr %x) {
  %a = load double, ptr %x
  %at = getelementptr i8, ptr %x, i64 8
  %b = load double, ptr %at
  %remainder = frem double %a, %b
  %nearest = call double @llvm.rint.f64(double %a)
  %low = call double @llvm.floor.f64(double %b)
  %both = fmul double %nearest, %low
  store double %remainder, ptr %x
  store double %both, ptr %at
  ret void
}
"""
ITS_CALL = """
#include <stdio.h>
void ortilo_f(double *);
int main(void) {
    double x[2] = {-21.4375, 6.28125};
    ortilo_f(x);
    printf("%ld %ld", (long)(x[0] * 65536.0), (long)(x[1] * 65536.0));
    return 0;
}
"""


@pytest.mark.parametrize("target", TARGETS)
def test_exact_functions_of_a_processors_library_take_numbers_as_it_does(target: str, tmp_path: Path) -> None:
    """LLVM calls an ARM's fmod with other registers than newlib reads, and says nothing: the tight filter was wrong."""
    needs(*programs_of(target))
    (tmp_path / "ortilo_elements.o").write_bytes(object_code({"ortilo_f": EXACT}, TARGETS[target]))
    (tmp_path / "ortilo.c").write_text("typedef int none;\n")
    (tmp_path / "call.c").write_text(ITS_CALL)
    build(tmp_path, target, tmp_path / "call.c", tmp_path / "call")
    said = do(*emulated(target, tmp_path / "call", "-nographic"), folder=tmp_path)
    remainder, both = (float(word) / 65536.0 for word in said.split())
    assert remainder == math.fmod(-21.4375, 6.28125)
    assert both == np.rint(-21.4375) * np.floor(6.28125)


SUMS = """
define void @ortilo_f(ptr %x) {
  %a = load double, ptr %x
  %at = getelementptr i8, ptr %x, i64 8
  %b = load double, ptr %at
  %sum = fadd double %a, %b
  %difference = fsub double %a, %b
  store double %sum, ptr %x
  store double %difference, ptr %at
  ret void
}
"""
ITS_SUMS = """
#include <stdint.h>
#include <stdio.h>
#include <string.h>
void ortilo_f(double *);
static const double pairs[][2] = {%s};
int main(void) {
    for (unsigned i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        uint64_t said[2];
        double x[2] = {pairs[i][0], pairs[i][1]};
        ortilo_f(x);
        memcpy(said, x, sizeof said);
        for (int k = 0; k < 2; k++)
            printf("%%08lx%%08lx ", (unsigned long)(said[k] >> 32), (unsigned long)(said[k] & 0xffffffff));
        printf("\\n");
    }
    return 0;
}
"""


@pytest.mark.parametrize("target", TARGETS)
def test_sums_of_all_exponents_apart_are_rounded_as_ieee_754_says(target: str, tmp_path: Path) -> None:
    """libgcc's double 1 - 0x1.c42a71ecfc1b5p-33 of a Cortex-M4 is a unit of the last place too small."""
    needs(*programs_of(target))
    rng = np.random.default_rng(0)
    gap = np.r_[np.tile(np.arange(70), 30), np.full(100, 33)]
    small = np.ldexp(rng.uniform(1.0, 2.0, gap.size), -gap) * rng.choice([-1.0, 1.0], gap.size)
    large = np.where(rng.random(gap.size) < 0.5, 1.0, rng.uniform(1.0, 2.0, gap.size)) * rng.choice([-1, 1], gap.size)
    tiny = np.array([[2.0**-989, 3.0 * 2.0**-1040], [2.0**-989, -(2.0**-1022) * (1.0 - 2.0**-52)], [math.inf, -1.0]])
    pairs = np.vstack([np.c_[large, small], np.c_[small, large], tiny])
    (tmp_path / "ortilo_elements.o").write_bytes(object_code({"ortilo_f": SUMS}, TARGETS[target]))
    (tmp_path / "ortilo.c").write_text(f"#include <stdint.h>\n#include <string.h>\n{SUM_TEXT}")
    text = ", ".join(f"{{{number_text(a)}, {number_text(b)}}}" for a, b in pairs.tolist())
    (tmp_path / "call.c").write_text("#include <math.h>\n" + ITS_SUMS % text)
    build(tmp_path, target, tmp_path / "call.c", tmp_path / "call")
    said = do(*emulated(target, tmp_path / "call", "-nographic"), folder=tmp_path)
    found = np.array([[int(word, 16) for word in line.split()] for line in said.splitlines()], np.uint64)
    assert (found == np.c_[pairs.sum(axis=1), pairs[:, 0] - pairs[:, 1]].view(np.uint64)).all()


def test_a_processor_that_is_not_there_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("export", "nominal_imu_uwb", "--target", "z80", "--out", str(tmp_path / "half")) == 2
    assert capsys.readouterr().err == "ortilo: --target: 'z80': must be one of cortex-m7, cortex-m4, aarch64, x86-64\n"
    assert not (tmp_path / "half").exists()


def test_the_manifest_says_what_was_exported(short: Scenario, exported: Exported) -> None:
    told = json.loads((exported(short) / "manifest.json").read_text())
    assert told["scenario"] == json.loads(short.model_dump_json())
    assert told["object_bytes"] == (exported(short) / "ortilo_elements.o").stat().st_size


def test_what_is_empty_has_a_brace_for_each_dimension() -> None:
    assert [values_text(np.zeros(shape)) for shape in ((0,), (0, 3), (2, 0, 1))] == ["{0}", "{{0}}", "{{{0}}}"]
    assert values_text(np.array([[1.0], [np.inf]])) == "{{0x1p+0},\n     {INFINITY}}"


FUNCTIONS = """
import json, sys
from ortilo_drake.codegen.single import compute_in_floats
compute_in_floats()
from numba import njit
from ortilo_drake.model.elementary import arctan2, cos, exp, sin
@njit
def of(x, y):
    return sin(x), cos(x), exp(y), arctan2(x, y)
print(json.dumps([of(x, y) for x, y in json.load(sys.stdin)]))
"""


@pytest.mark.long
def test_functions_in_floats_are_right_to_two_ulps(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    arguments = np.concatenate([rng.uniform(-s, s, (500, 2)) for s in (0.1, 2.0, 50.0)]).astype(np.float32)
    done = subprocess.run(
        [sys.executable, "-c", FUNCTIONS], input=json.dumps(arguments.tolist()), text=True, capture_output=True,
        check=True, env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
    )  # fmt: skip
    for (x, y), found in zip(arguments.tolist(), json.loads(done.stdout), strict=True):
        with mpmath.workdps(40):
            exact = mpmath.sin(x), mpmath.cos(x), mpmath.exp(y), mpmath.atan2(x, y)
            for value, its in zip(found, exact, strict=True):
                assert np.float32(value) == value
                assert abs(mpmath.mpf(value) - its) <= 2.0 * float(np.spacing(np.float32(abs(float(its))))), (x, y)


@pytest.mark.long
def test_the_code_for_a_processor_without_doubles_has_none(short: Scenario, exported: Exported) -> None:
    needs("arm-none-eabi-objdump", "arm-none-eabi-nm")
    there = exported(short, "cortex-m4", precision="single")
    code = do("arm-none-eabi-objdump", "-d", "ortilo_elements.o", folder=there)
    assert "vmul.f32" in code
    assert not re.findall(r"\S*\.f64\S*", code)
    asked = do("arm-none-eabi-nm", "-u", "ortilo_elements.o", folder=there).split()
    assert not [name for name in asked if re.search(r"__aeabi_(?:c?d|\w+2d|\w*f2u?lz)|^sqrt$|_?df", name)]
    for name in ("ortilo.h", "ortilo.c"):
        assert not re.search(r"\bdouble\b", (there / name).read_text())


@pytest.mark.long
@pytest.mark.parametrize("target", ["x86-64", "cortex-m4"])
def test_the_golden_test_is_passed(target: str, short: Scenario, exported: Exported, tmp_path: Path) -> None:
    said = do(*golden(exported(short, target, precision="single"), target, tmp_path), folder=tmp_path)
    assert re.fullmatch(r"0 of 60 ticks differ; at most \d+ um, \d+ urad\n", said)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "target"), [("nominal_imu_uwb", "x86-64"), ("nominal_imu_uwb", "cortex-m4"), ("imu_uwb", "x86-64")]
)
def test_a_flight_stays_within_a_millimetre_and_a_tenth_of_a_degree(name: str, target: str, exported: Exported) -> None:
    needs(*programs_of(target))
    scenario = load_scenario(name, SHORT)
    flown = flown_by(exported(scenario, target, precision="single"), scenario)
    its = fly_lockstep(scenario, in_this_process(scenario))
    for signal in ("truth", "estimate"):
        apart = np.abs(flown[signal].values - its[signal].values)
        assert 0.0 < apart[:, :3].max() < 1e-3
        assert np.rad2deg(apart[:, 3:6].max()) < 0.1


def test_what_has_not_flown_near_doubles_is_refused_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        export(load_scenario("robust_imu_uwb"), "cortex-m4", tmp_path, precision="single")
    assert str(refused.value).startswith("--precision: single: ")
    assert str(refused.value).endswith(" has not been flown within 1 mm of doubles")
    assert "\n" not in str(refused.value)
    assert not [*tmp_path.iterdir()]


def test_what_flew_far_from_doubles_is_refused_in_a_line_that_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refused:
        export(load_scenario("tight_imu_uwb"), "cortex-m4", tmp_path, precision="single")
    said = "came 850 mm and 52 degrees within 46 ticks from doubles, 1 mm and 0.1 degree are allowed"
    assert str(refused.value) == f"--precision: single: filter: the element 'tight' {said}"


def test_another_precision_is_refused_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("export", "nominal_imu_uwb", "--precision", "half", "--out", str(tmp_path / "half")) == 2
    assert capsys.readouterr().err == "ortilo: --precision: 'half': must be one of double, single\n"
