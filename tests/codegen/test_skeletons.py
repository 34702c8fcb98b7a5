"""The skeletons for autopilots compile against an export's header and stubs of what they need of the autopilot."""

import re
import shutil
from pathlib import Path

from exports import do, needs

from ortilo_drake.codegen.c_header import header_text
from ortilo_drake.codegen.c_source import source_text
from ortilo_drake.codegen.exported_half import STRICT
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.scenario import load_scenario

STUBS = Path(__file__).with_name("stubs")
EXAMPLES = Path(__file__).parents[2] / "examples"


def write_header(folder: Path) -> None:
    scenario = load_scenario("nominal_imu_uwb")
    half = onboard_half(scenario)
    (folder / "ortilo.h").write_text(header_text(half, scenario, source_text(half, False)[1], False))


def test_the_crazyflies_controller_compiles(tmp_path: Path) -> None:
    needs("gcc")
    write_header(tmp_path)
    source = EXAMPLES / "crazyflie" / "controller_ortilo.c"
    do("gcc", *STRICT, "-std=c11", "-I", STUBS, "-I.", "-c", source, folder=tmp_path)


def test_the_work_item_of_px4_compiles(tmp_path: Path) -> None:
    needs("g++")
    write_header(tmp_path)
    source = EXAMPLES / "px4" / "OrtiloControl.cpp"
    for name in re.findall(r"#include <((?:px4_platform_common|uORB)/[^>]+)>", source.read_text()):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(STUBS / "px4.hpp", tmp_path / name)
    (tmp_path / "use.cpp").write_text(f'#include "{source}"\nOrtiloControl &make();\n'
                                      "OrtiloControl &make() { static OrtiloControl it; return it; }\n")  # fmt: skip
    text = (STUBS / "px4.hpp").read_text().replace("#pragma once\n", "")
    for copy in tmp_path.glob("*/**/*.h*"):
        copy.write_text(f"#ifndef STUB_PX4\n#define STUB_PX4\n{text}#endif\n")
    do("g++", *STRICT, "-std=c++17", "-I.", "-c", "use.cpp", folder=tmp_path)
