"""The export of an onboard half: object code, C header and source, golden vectors and their test, in one folder."""

from __future__ import annotations  # help() shows types by their names

import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import llvmlite
import numba

from ortilo_drake.codegen.c_header import ROOM_BYTES, header_text
from ortilo_drake.codegen.c_source import TEMPLATES, source_text
from ortilo_drake.codegen.cmake_files import cmake_files
from ortilo_drake.codegen.exported_half import flown_ticks, golden_text
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.codegen.ir import makes_arrays, neutral_irs
from ortilo_drake.codegen.object_code import object_code
from ortilo_drake.codegen.readme import readme_text
from ortilo_drake.codegen.single import check_near, with_floats
from ortilo_drake.codegen.targets import target_of
from ortilo_drake.compiled.digest import digest_of
from ortilo_drake.flight.files import write_bytes, write_text
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario

TICKS: Final = 300
PRECISIONS: Final = ("double", "single")


def export(
    scenario: str | Path | Scenario,
    target: str,
    folder: str | Path,
    ticks: int = TICKS,
    precision: str = "double",
) -> dict[str, Any]:
    """Write the onboard half of a scenario for a processor; return the manifest.

    An example is `od.export("imu_uwb", "cortex-m7", "half")`. All contents are made before any file is written.
    InputError if a part cannot be exported, or there is no such processor.

    Args:
        scenario: a ready-made scenario's name, a .yaml file, or a Scenario; its seed is used for the golden vectors.
        target: a processor of codegen/targets.py.
        folder: folder for ortilo_elements.o, ortilo.c, ortilo.h, golden.h, test_golden.c, README.md, manifest.json
            and the files of cmake_files.py.
        ticks: number of ticks in the golden vectors.
        precision: "double", with the bits of Python, or "single", for processors without doubles: see single.py.
    """
    if precision not in PRECISIONS:
        raise InputError(f"--precision: {precision!r}: must be one of {', '.join(PRECISIONS)}")
    scenario, to, single = load_scenario(scenario), target_of(target), precision == "single"
    half = onboard_half(scenario)
    if single:
        check_near(half.wiring.boxes.values())
    irs = neutral_irs(scenario, single)
    code = object_code(irs, to)
    makes = any(map(makes_arrays, irs.values()))
    source, sizes = source_text(half, makes, to.adds_in_library and not single, single)
    golden = golden_text(*flown_ticks(scenario, ticks), single)
    header = header_text(half, scenario, sizes, makes)
    width = 4 if single else 8
    manifest = {
        "scenario": json.loads(scenario.model_dump_json()),
        "precision": precision,
        "target": {"name": target, "triple": to.triple, "cpu": to.cpu, "features": to.features},
        "digest": digest_of(*sorted(irs.items()), source),
        "state_bytes": width * sizes["state"] + 8,
        "ram_bytes": width * (sizes["state"] + sizes["said"] + sizes["work"]) + 16,
        "room_bytes": ROOM_BYTES if makes else 0,
        "object_bytes": len(code),
        "versions": {
            "ortilo_drake": version("ortilo_drake"), "python": platform.python_version(),
            "numba": numba.__version__, "llvmlite": llvmlite.__version__,
        },
    }  # fmt: skip
    there = Path(folder)
    write_bytes(there / "ortilo_elements.o", code)
    for name, text in {
        "ortilo.c": source,
        "ortilo.h": with_floats(header) if single else header,
        "golden.h": golden,
        "README.md": readme_text(half, scenario, target, manifest),
        "manifest.json": json.dumps(manifest, indent=2) + "\n",
        "test_golden.c": (TEMPLATES / ("test_golden_single.c" if single else "test_golden.c")).read_text(),
        **cmake_files(target),
    }.items():
        write_text(there / name, text)
    return manifest
