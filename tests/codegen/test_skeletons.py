"""The skeletons for autopilots compile against an export's header and stubs of what they need of the autopilot."""

import re
import shutil
from pathlib import Path

from exports import Exported, do, needs

from ortilo_drake.codegen.exported_half import STRICT
from ortilo_drake.scenario import Scenario

STUBS = Path(__file__).with_name("stubs")
EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_crazyflies_controller_compiles(short: Scenario, exported: Exported, tmp_path: Path) -> None:
    needs("gcc")
    source = EXAMPLES / "crazyflie" / "controller_ortilo.c"
    do("gcc", *STRICT, "-std=c11", "-I", STUBS, "-I", exported(short), "-c", source, folder=tmp_path)


def test_the_work_item_of_px4_compiles(short: Scenario, exported: Exported, tmp_path: Path) -> None:
    needs("g++")
    source = EXAMPLES / "px4" / "OrtiloControl.cpp"
    for name in re.findall(r"#include <((?:px4_platform_common|uORB)/[^>]+)>", source.read_text()):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(STUBS / "px4.hpp", tmp_path / name)
    (tmp_path / "use.cpp").write_text(f'#include "{source}"\nOrtiloControl &make();\n'
                                      "OrtiloControl &make() { static OrtiloControl it; return it; }\n")  # fmt: skip
    text = (STUBS / "px4.hpp").read_text().replace("#pragma once\n", "")
    for copy in tmp_path.glob("*/**/*.h*"):
        copy.write_text(f"#ifndef STUB_PX4\n#define STUB_PX4\n{text}#endif\n")
    do("g++", *STRICT, "-std=c++17", "-I.", "-I", exported(short), "-c", "use.cpp", folder=tmp_path)
